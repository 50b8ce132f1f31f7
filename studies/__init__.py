"""Driver scripts, one file a study, and the command line."""
