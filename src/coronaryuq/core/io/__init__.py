"""Files: atomic writes, tables, VTK, modification times, one campaign per folder."""
