"""Range beams that are not to be believed: a room for each way to go wrong."""
