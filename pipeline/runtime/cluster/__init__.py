"""Work on the workers of a dask cluster: `dask worker` processes in which this package is installed."""
