"""Project files: their content, its check, and writing one from the files of a folder."""
