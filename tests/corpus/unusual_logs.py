"""Logs that are unusual, and read all the same."""

import numpy as np
import scipy.io

from . import recorded_bags
from .faults import csv, fault, joined, lines
from .recorded_axis import sound, table, write


@fault("accepted")
def byte_order_mark(folder):
    return [write(folder, b"\xef\xbb\xbf" + table(*sound()).encode())]


@fault("accepted")
def carriage_returns(folder):
    return csv(folder, *sound(), end="\r\n")


@fault("accepted")
def a_form_feed_and_a_line_separator_inside_fields(folder):
    rows = [f"{row},ok" for row in lines()[1:]]
    rows[100], rows[200] = rows[100].replace(",", ",\f", 1), rows[200].replace("ok", "first\u2028second")
    return [write(folder, joined(["time_s,u,y,note", *rows]))]


@fault("accepted")
def semicolons(folder):
    return csv(folder, *sound(), separator=";")


@fault("accepted")
def tabs(folder):
    return csv(folder, *sound(), separator="\t")


@fault("accepted")
def blanks_and_no_names(folder):
    text = table(*sound(), separator="  ").split("\n", 1)[1]
    return [write(folder, text, "log.dat"), "--time", "1", "--input", "2", "--output", "3"]


@fault("accepted")
def utf_16_with_mark(folder):
    return [write(folder, table(*sound()).encode("utf-16"))]


@fault("accepted")
def quoted_names(folder):
    return csv(folder, *sound(), names=('"time_s"', '"u"', '"y"'))


@fault("accepted")
def blank_lines(folder):
    return [write(folder, table(*sound()).replace("\n", "\n\n"))]


@fault("accepted")
def no_line_break_at_the_end(folder):
    return [write(folder, table(*sound()).rstrip())]


@fault("accepted")
def a_symbolic_link(folder):
    (folder / "link.csv").symlink_to(write(folder, table(*sound())))
    return [folder / "link.csv"]


@fault("accepted")
def arrays(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, signals=np.column_stack([u, y]))
    return [folder / "log.npz", "--input", "signals[0]", "--output", "signals[1]"]


@fault("accepted")
def matlab(folder):
    time, u, y = sound()
    scipy.io.savemat(folder / "log.mat", {"time_s": time, "u": u[:, None], "Y": np.column_stack([u, y])})
    return [folder / "log.mat", "--output", "Y[1]"]


@fault("accepted")
def a_bag(folder):
    return recorded_bags.joint_states(folder / "bag", *sound())
