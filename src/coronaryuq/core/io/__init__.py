"""Atomic writes, tables, VTK files, modification times, and a lock per results folder."""
