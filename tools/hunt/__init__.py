"""The search for a room that breaks the flight: random and guided, shrunk, kept (README.md)."""
