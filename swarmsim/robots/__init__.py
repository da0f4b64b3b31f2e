"""What robots are made of: bodies, sensors, localisation and motion."""
