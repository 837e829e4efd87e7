"""The lumen as a surface: centrelines, implicit functions, caps, mesh grading."""
