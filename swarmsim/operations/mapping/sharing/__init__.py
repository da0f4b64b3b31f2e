"""What mapping robots tell each other, byte by byte."""
