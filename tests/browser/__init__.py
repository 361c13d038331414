"""Tests of the local page; a package, so that its browser and event loop end with its last test."""
