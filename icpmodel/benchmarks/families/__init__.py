"""Random families of problems, one file per field, for `icpmodel benchmark choice`."""
