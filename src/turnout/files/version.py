"""The version of the installed program, looked up when this module is first loaded."""

from turnout.files.provenance import version

VERSION = version()
