"""What swarms know and keep together beside what they map: a table, data items, and work that needs no neighbours."""
