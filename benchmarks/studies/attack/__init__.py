"""Hostile input of four parts: panels, recordings, sweeps, requests of the studio."""
