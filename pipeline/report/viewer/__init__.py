"""A run in the Rerun viewer, while it goes or from a file; the extra `viz` brings the viewer."""

from wiclosure.pipeline.report.viewer.rerun_viewer import RerunViewer as RerunViewer
from wiclosure.pipeline.report.viewer.window import Window as Window
