"""From the files of a data acquisition system to datasets in the terms of the schema."""
