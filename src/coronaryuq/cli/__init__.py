"""The command line `coronaryuq`."""
