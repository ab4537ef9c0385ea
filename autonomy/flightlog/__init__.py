"""What happened: every input and decision of a flight, recorded and read back."""
