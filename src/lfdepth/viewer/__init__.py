"""A light field and its maps in the browser: served, exported to one file, or inside a notebook."""
