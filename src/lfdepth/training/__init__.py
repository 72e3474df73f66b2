"""Training of learned systems on scenes that are rendered while it runs."""
