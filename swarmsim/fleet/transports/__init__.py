"""What carries frames from one robot's process to the others."""
