"""Project files: what they hold, how they are checked, and how one is written from what a folder holds."""
