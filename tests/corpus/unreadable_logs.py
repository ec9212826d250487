"""Logs that can't be read."""

import gzip
import io
import os
import pickle
import warnings
import zipfile

import numpy as np
import scipy.io
from rosbags.rosbag2 import StoragePlugin

from . import recorded_bags
from .faults import csv, fault, joined, lines
from .recorded_axis import sound, table, write


@fault("refused", "no-such-file")
def a_missing_file(folder):
    return [folder / "log.csv"]


@fault("refused", "no-such-file")
def a_link_to_nothing(folder):
    (folder / "link.csv").symlink_to(folder / "gone.csv")
    return [folder / "link.csv"]


@fault("refused", "unreadable")
def a_link_to_itself(folder):
    (folder / "link.csv").symlink_to(folder / "link.csv")
    return [folder / "link.csv"]


@fault("refused", "unreadable")
def a_pipe(folder):
    os.mkfifo(folder / "log.csv")
    return [folder / "log.csv"]


@fault("refused", "too-large")
def a_sparse_file_of_2_gb(folder):
    with (folder / "log.csv").open("wb") as stream:
        stream.truncate(2 * 2**30)
    return [folder / "log.csv"]


@fault("refused", "empty")
def an_empty_file(folder):
    return [write(folder, "")]


@fault("refused", "empty")
def only_blank_lines(folder):
    return [write(folder, "\n \n\n")]


@fault("refused", "no-data")
def names_and_nothing_else(folder):
    return [write(folder, "time_s,u,y\n")]


@fault("refused", "encoding")
def chinese_names_in_gbk(folder):
    return [write(folder, table(*sound()).replace("time_s", "时间").encode("gbk"))]


@fault("refused", "zero-bytes")
def utf_16_without_mark(folder):
    return [write(folder, table(*sound()).encode("utf-16-le"))]


@fault("refused", "encoding")
def a_pickle(folder):
    return [write(folder, pickle.dumps(sound()), "log.csv")]


@fault("refused", "unknown-format")
def compressed(folder):
    return [write(folder, gzip.compress(table(*sound()).encode()), "log.csv.gz")]


@fault("refused", "unknown-format")
def a_folder(folder):
    return [folder]


@fault("refused", "unknown-format")
def a_single_array(folder):
    np.save(folder / "log.npy", sound()[0])
    return [folder / "log.npy"]


@fault("refused", "unknown-format")
def matlab_7_3(folder):
    return [write(folder, b"\x89HDF\r\n\x1a\n" + bytes(100), "log.mat")]


@fault("refused", "no-column")
def another_column(folder):
    return [*csv(folder, *sound()), "--output", "angle"]


@fault("refused", "no-column")
def a_number_beyond_the_columns(folder):
    text = table(*sound()).split("\n", 1)[1]
    return [write(folder, text, "log.dat"), "--time", "1", "--input", "2", "--output", "4"]


@fault("refused", "unclear-names")
def a_value_missing_in_the_first_line_without_names(folder):
    rows = lines()[1:]
    rows[0] = rows[0].split(",")[0] + ",," + rows[0].split(",")[2]
    return [write(folder, joined(rows), "log.dat"), "--time", "1", "--input", "2", "--output", "3"]


@fault("refused", "comment")
def samples_taken_out_by_a_mark(folder):
    rows = [f"{k},{row}" for k, row in enumerate(lines()[1:])]
    rows[300:305] = [f"#{row}" for row in rows[300:305]]
    return [write(folder, joined(["count,time_s,u,y", *rows]))]


@fault("refused", "column-twice")
def two_columns_of_one_name(folder):
    return csv(folder, *sound(), names=("time_s", "u", "u"))


@fault("refused", "not-a-number")
def a_word_among_numbers(folder):
    rows = lines()
    rows[300] = rows[300].split(",")[0] + ",0.1,overflow"
    return [write(folder, joined(rows))]


@fault("refused", "not-a-number")
def commas_of_thousands(folder):
    rows = [f"{k};{1000 + k:,};{2000 + k:,}" for k in range(200)]
    return [write(folder, "time_s;u;y\n" + joined(rows))]


@fault("refused", "infinite")
def an_infinity(folder):
    time, u, y = sound()
    y[100] = np.inf
    return csv(folder, time, u, y)


@fault("refused", "row-length")
def decimal_commas_between_commas(folder):
    return [write(folder, "time_s,u,y\n" + joined(f"0,{k:03d},1,{k:03d},2,{k:03d}" for k in range(200)))]


@fault("refused", "row-length")
def an_index_without_a_name(folder):
    rows = [f"{k},{row}" for k, row in enumerate(lines()[1:])]
    return [write(folder, joined(["time_s,u,y", *rows]))]


@fault("refused", "row-length")
def a_separator_lost_on_the_wire(folder):
    rows = [f"{row},{k}" for k, row in enumerate(lines()[1:])]
    rows[300] = "3.0,0.250.24,300"
    return [write(folder, joined(["time_s,u,y,count", *rows]))]


@fault("refused", "row-length")
def a_value_missing_between_blanks(folder):
    rows = [f"{row} {k}".replace(",", " ") for k, row in enumerate(lines()[1:])]
    rows[300] = "3.0  0.24 300"
    return [write(folder, joined(["time_s u y count", *rows]))]


@fault("refused", "open-quote")
def an_open_quotation_mark(folder):
    rows = lines()
    rows[100] = rows[100].replace(",", ',"', 1)
    return [write(folder, joined(rows))]


@fault("refused", "open-quote")
def an_open_quotation_mark_in_the_last_line(folder):
    rows = lines()
    rows[-1] = rows[-1].replace(",", ',"', 1)
    return [write(folder, joined(rows))]


@fault("refused", "open-quote")
def an_open_quotation_mark_in_the_names(folder):
    return csv(folder, *sound(), names=("time_s", "u", '"y'))


@fault("refused", "open-quote")
def a_note_that_ends_200_lines_later(folder):
    # A value is missing as well, so that the lines are cut into fields one by one.
    rows = [f"{row},ok" for row in lines()[1:]]
    rows[50] = "0.5,,0.1,ok"
    rows[100], rows[300] = rows[100].replace("ok", '"touched'), rows[300].replace("ok", 'twice"')
    return [write(folder, joined(["time_s,u,y,note", *rows]))]


@fault("refused", "open-quote")
def a_quoted_note_of_140000_characters(folder):
    rows = [f"{row},ok" for row in lines()[1:]]
    rows[100] = rows[100].replace("ok", f'"{"a" * 140_000}"')
    return [write(folder, joined(["time_s,u,y,note", *rows]))]


@fault("refused", "header-repeated")
def two_logs_in_one_file(folder):
    text = table(*sound())
    return [write(folder, text + text)]


@fault("refused", "missing-values")
def signals_in_alternate_rows(folder):
    time, u, y = sound()
    u, y = u.copy(), y.copy()
    u[::2], y[1::2] = np.nan, np.nan
    return csv(folder, time, u, y)


@fault("refused", "not-a-number")
def arrays_of_objects(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u.astype(object), y=y)
    return [folder / "log.npz"]


@fault("refused", "too-large")
def a_zip_bomb(folder):
    _, u, y = sound()
    np.savez(folder / "log.npz", u=u, y=y)
    with zipfile.ZipFile(folder / "log.npz", "a") as archive:
        archive.writestr("time_s.npy", b"")
        # What a file of a few kilobytes unpacks to is told by its directory, written at the end.
        archive.getinfo("time_s.npy").file_size = 600 * 2**20
    return [folder / "log.npz"]


@fault("refused", "damaged")
def an_array_that_claims_more_than_it_holds(folder):
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(folder / "log.npz", "w") as archive:
        for name in ("time_s", "u", "y"):
            archive.writestr(f"{name}.npy", member.getvalue())
    return [folder / "log.npz"]


@fault("refused", "damaged")
def half_an_archive(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u, y=y)
    content = (folder / "log.npz").read_bytes()
    return [write(folder, content[: len(content) // 2], "log.npz")]


@fault("refused", "damaged")
def a_flipped_bit_in_an_archive(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u, y=y)
    content = bytearray((folder / "log.npz").read_bytes())
    content[1000] ^= 1
    return [write(folder, bytes(content), "log.npz")]


@fault("refused", "column-twice")
def arrays_appended_under_the_same_names(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u, y=y)
    with zipfile.ZipFile(folder / "log.npz", "a") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, array in {"time_s": time, "u": u, "y": y}.items():
            with archive.open(f"{name}.npy", "w") as member:
                np.save(member, array[300:])
    return [folder / "log.npz"]


@fault("refused", "length")
def arrays_of_different_length(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u[:-1], y=y)
    return [folder / "log.npz"]


@fault("refused", "no-column")
def an_array_that_is_not_there(folder):
    time, u, y = sound()
    np.savez(folder / "log.npz", time_s=time, u=u, angle=y)
    return [folder / "log.npz"]


@fault("refused", "damaged")
def a_matlab_file_cut_off(folder):
    time, u, y = sound()
    scipy.io.savemat(folder / "log.mat", {"time_s": time, "u": u, "y": y})
    return [write(folder, (folder / "log.mat").read_bytes()[:-200], "log.mat")]


@fault("refused", "not-a-number")
def a_matlab_cell(folder):
    time, u, y = sound()
    scipy.io.savemat(folder / "log.mat", {"time_s": time, "u": u, "y": np.array([y, y[:3]], dtype=object)})
    return [folder / "log.mat"]


@fault("refused", "not-a-number")
def a_matlab_variable_with_an_imaginary_part(folder):
    time, u, y = sound()
    scipy.io.savemat(folder / "log.mat", {"time_s": time, "u": u, "y": y + 0.5j})
    return [folder / "log.mat"]


@fault("refused", "damaged")
def half_a_bag(folder):
    words = recorded_bags.joint_states(folder / "bag", *sound())
    storage = next((folder / "bag").glob("*.db3"))
    storage.write_bytes(storage.read_bytes()[:20000])
    return words


@fault("refused", "damaged")
def a_bag_with_a_page_of_zeros(folder):
    words = recorded_bags.joint_states(folder / "bag", *sound(), plugin=StoragePlugin.MCAP)
    storage = next((folder / "bag").glob("*.mcap"))
    content = storage.read_bytes()
    storage.write_bytes(content[:32768] + bytes(4096) + content[36864:])  # 219 messages come before
    return words


@fault("refused", "no-column")
def a_topic_that_is_not_there(folder):
    words = recorded_bags.joint_states(folder / "bag", *sound())
    return [*words[:-1], "/imu/orientation.x"]


@fault("refused", "no-column")
def a_joint_that_is_not_there(folder):
    words = recorded_bags.joint_states(folder / "bag", *sound())
    return [*words[:-1], "/joint_states/roll/position"]


@fault("refused", "no-data")
def a_topic_without_messages(folder):
    time, u, y = sound()
    return recorded_bags.joint_states(folder / "bag", time[:0], u[:0], y[:0])
