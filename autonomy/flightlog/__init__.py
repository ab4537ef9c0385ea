"""What happened: every input and every decision of a flight, so that it can be done again."""
