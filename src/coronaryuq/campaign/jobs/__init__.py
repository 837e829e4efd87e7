"""Functions of jobs that join several stages; all others are functions of their stage."""
