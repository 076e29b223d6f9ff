"""The command line: from words to options of an algorithm and back, help pages, completion, the terminal."""
