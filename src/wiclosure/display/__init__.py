"""How results show themselves in Python: as HTML in notebooks, as pictures, as data frames."""

from wiclosure.display.closure_columns import closure_columns as closure_columns
from wiclosure.display.frames import data_frame as data_frame
from wiclosure.display.html import html_table as html_table
from wiclosure.display.names import listed as listed
from wiclosure.display.numbers import significant as significant
from wiclosure.display.plots import plot_kept_pairs as plot_kept_pairs
from wiclosure.display.plots import plot_paths as plot_paths
