"""Objects as plain data and arrays: the content of the file of a reduced model."""
