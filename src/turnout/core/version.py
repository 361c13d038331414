"""The version of the installed program, looked up when this module is first loaded."""

from turnout.core.provenance import version

VERSION = version()
