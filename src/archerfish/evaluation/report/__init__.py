"""The report of a run: one self-contained page that lays every table and figure of the paper beside ours."""

from archerfish.evaluation.report.page import write_report

__all__ = ["write_report"]
