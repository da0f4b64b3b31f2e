"""A benchmark that others can enter: frozen tasks, entries, scores, and the page that compares them."""
