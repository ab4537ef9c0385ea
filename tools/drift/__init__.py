"""What the fix by known walls is worth, over rooms, modes and levels of drift."""
