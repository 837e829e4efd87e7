"""The campaign as a workflow: its paths, its lists of jobs, and the functions of jobs that join several stages."""
