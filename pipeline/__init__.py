"""Stages strung together: one log from file to published answer, and the command line."""
