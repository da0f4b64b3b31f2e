"""The Python interface: what `import swarmsim as sw` offers."""
