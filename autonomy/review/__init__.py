"""After the flight: flown again from its log, judged, explained, shown."""
