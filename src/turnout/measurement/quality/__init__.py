"""Quality of the recording of a throw: usable or not."""
