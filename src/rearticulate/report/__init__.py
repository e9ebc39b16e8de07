"""What a person reads: the one-file page, the static pictures and the summary both are made from."""
