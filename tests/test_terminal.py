import io
import os

import pytest

from hilbertvae.terminal import show_any_text


@pytest.mark.parametrize(
    ("encoding", "shown"), [("ascii", b"1?2 ?? ?\n"), ("latin-1", b"1\xb12 ?? ?\n"), ("utf-8", "1±2 日本 ?\n".encode())]
)
def test_what_an_encoding_lacks_is_a_question_mark(encoding, shown, monkeypatch):
    said = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr("sys.stdout", said)
    show_any_text()
    print("1±2 日本", os.fsdecode(b"\xfc"), flush=True)
    assert said.buffer.getvalue() == shown.replace(b"\n", os.linesep.encode())


@pytest.mark.parametrize("other", [None, io.StringIO()], ids=["none", "notebook"])
def test_outputs_of_another_kind_are_left_as_they_are(other, monkeypatch):
    monkeypatch.setattr("sys.stdout", other)
    show_any_text()
