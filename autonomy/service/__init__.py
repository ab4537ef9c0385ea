"""How people and programs talk to the running service."""
