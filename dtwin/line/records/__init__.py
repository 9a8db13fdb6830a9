"""What is kept of runs of a line, and told of them: files, tables, pages, recordings."""
