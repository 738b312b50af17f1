"""What commands print, write and compare."""
