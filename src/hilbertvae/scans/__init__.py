"""Readers of laser scans, and the catalogue of the sites they were taken at."""
