"""Writes reference.tfevents with TensorBoard's own writer: pip install tensorboard==2.21.0; python reference.py"""

import glob
import os
import tempfile
import time

from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.event_file_writer import EventFileWriter

BEGIN = 1_700_000_000.0


def scalars(seconds, step, **values):
    values = [Summary.Value(tag=tag.replace("__", "/"), simple_value=value) for tag, value in values.items()]
    return Event(wall_time=BEGIN + seconds, step=step, summary=Summary(value=values))


time.time = lambda: BEGIN
with tempfile.TemporaryDirectory() as folder:
    writer = EventFileWriter(folder)
    writer.add_event(Event(wall_time=BEGIN + 0.25, step=41, session_log=SessionLog(status=SessionLog.START)))
    writer.add_event(scalars(0.5, 41, train__loss=0.75, train__lr=1e-4))
    writer.add_event(scalars(1.5, 30_000, train__grad_norm=0.0))
    writer.add_event(scalars(2.5, 0, eval__loss=float("nan")))
    writer.close()
    (written,) = glob.glob(os.path.join(folder, "*tfevents*"))
    with open(written, "rb") as file, open(os.path.join(os.path.dirname(__file__), "reference.tfevents"), "wb") as out:
        out.write(file.read())
