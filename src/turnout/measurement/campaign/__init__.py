"""Campaigns: a folder of recordings with its run sheet."""
