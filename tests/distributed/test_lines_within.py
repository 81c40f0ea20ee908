"""A text is cut into ranges of bytes, of which each has whole lines."""

import io
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from icpmodel.distributed.rows_of_files import lines_within


@given(
    head=st.binary(max_size=9).map(lambda head: head.replace(b"\n", b"%") + b"\n"),
    lines=st.lists(st.text("12. \r", max_size=7).map(lambda line: line.encode() + b"\n"), max_size=12),
    parts=st.integers(1, 9),
)
def test_every_line_is_in_one_range_whole(head, lines, parts):
    raw, begin, size = io.BytesIO(head + b"".join(lines)), len(head), sum(map(len, lines))
    ends = [begin + size * k // parts for k in range(parts + 1)]
    found = [list(lines_within(raw, begin, *part)) for part in pairwise(ends)]
    assert [line for part in found for line in part] == lines
