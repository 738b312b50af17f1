"""One file for each kind of result: its columns, its rows, and the words around them."""
