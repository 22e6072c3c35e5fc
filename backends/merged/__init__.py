"""The merged map: points, files, occupancy."""
