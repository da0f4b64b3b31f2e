"""Methods that step an equation in pieces, each of which reads a few cells beyond its own."""
