"""Exact solutions of linear scenes with relaxation laws."""
