"""The vehicle: its one door to MAVSDK, the guard before the wire, the deadman."""
