"""The parts of robots: bodies, sensors, localisation and motion."""
