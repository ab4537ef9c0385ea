"""Campaigns of closed-loop flights: planners x worlds x seeds x sensors x response. README.md."""
