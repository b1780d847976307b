# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The name of the official, as it is kept between two starts."""

from __future__ import annotations

from collections.abc import Callable
import os
import pathlib
import threading

from evgp_node.folder import rcs_folder
from evgp_node.official import MOST
from evgp_rcs_console.settings import keep, kept, NAME, Signature
import pytest


@pytest.fixture
def kept_in(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> pathlib.Path:
    """Return the file in which the name is kept; it does not exist yet."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'ros'))
    return rcs_folder() / 'official'


def test_a_name_that_is_given_counts_before_the_one_that_is_kept(kept_in: pathlib.Path) -> None:
    keep(NAME, 'Anna')

    assert [each.name for each in kept_in.parent.iterdir()] == ['official']
    assert [Signature().name, Signature('Bob').name] == ['Anna', 'Bob']
    assert Signature(process=4711).claim.endswith(' 4711)')
    keep(NAME, '')  # who wants no name has been asked
    assert (kept(NAME), Signature().name) == ('', '')


def write_rubbish(path: pathlib.Path) -> None:
    path.write_bytes(b'\xff\x1b[2J\n' * 100_000)


def make_unreadable(path: pathlib.Path) -> None:
    path.write_text('Anna')
    path.chmod(0)


@pytest.mark.parametrize(
    'make',
    [write_rubbish, make_unreadable, pathlib.Path.mkdir, os.mkfifo],
    ids=lambda each: each.__name__,
)
def test_a_file_that_holds_no_name_hinders_nobody(
    kept_in: pathlib.Path, make: Callable[[pathlib.Path], object]
) -> None:
    kept_in.parent.mkdir(parents=True)
    make(kept_in)

    name = Signature().name

    assert len(name) <= MOST
    assert name.isprintable()


def test_where_no_name_can_be_kept_it_counts_all_the_same(
    kept_in: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept_in.parent.parent.write_text('not a folder')
    signature = Signature()

    signature.sign('Anna')

    for thread in threading.enumerate():
        if thread.name.endswith('(save)'):  # Python calls it after what it runs
            thread.join(10)
    assert signature.name == 'Anna'
    assert 'not saved' in capsys.readouterr().err
