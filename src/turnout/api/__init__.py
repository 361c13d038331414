"""Additions of the public interface to packages below: results that show and save themselves."""
