"""One module a table of the papers, ours beside theirs."""
