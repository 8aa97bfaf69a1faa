"""Reading files that users give, and writing files whole."""
