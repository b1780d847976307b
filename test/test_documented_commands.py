# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The command lines in documents are ones that make, `rcs_ctl` and the services accept."""

from __future__ import annotations

from collections.abc import Iterator
import importlib.util
import re
import shlex
import subprocess
from typing import Any

from evgp_rcs_console.catalogue import CATALOGUE
from evgp_rcs_console.command_line import parse
from evgp_rcs_msgs import srv
import pytest
from test_documents import DOCUMENTS, ROOT, text_of
import yaml

MAKEFILE = (ROOT / 'Makefile').read_text()
VARIABLES = {'ARGS', 'PYTHON', *re.findall(r'^(\w+) [:?]=', MAKEFILE, re.MULTILINE)}
SERVICES = {
    '/kart_bridge/acknowledge': 'Acknowledge',
    **{f'/rcs/{each.service}': each.service_type for each in CATALOGUE.values()},
}
"""The type of each service."""


def commands(document: str) -> Iterator[list[str]]:
    """Yield the words of each command line in a document, without what the shell does."""
    text = text_of(document).replace('\\\n', ' ')
    fenced = re.findall(r'^ *```sh\n(.*?)^ *```', text, re.MULTILINE | re.DOTALL)
    inline = re.findall(r'`([^`\n]+)`', re.sub(r'```.*?```', '', text, flags=re.DOTALL))
    for line in (*(each for block in fenced for each in block.splitlines()), *inline):
        for part in re.split(r'&&|; |\||>', line):
            try:
                words = shlex.split(part, comments=True)
            except ValueError:
                continue  # prose with an apostrophe
            while words and re.match(r'[A-Z_]+=', words[0]):
                del words[0]  # a variable for this command
            if words[:1] in (['make'], ['ros2'], ['setup/in-workspace']):
                yield words


ALL = [(each, words) for each in DOCUMENTS for words in commands(each)]


def of(*start: str) -> list[Any]:
    """Return the commands that begin with these words, as parameters of a test."""
    return [
        pytest.param(words, id=f'{document}: {" ".join(words)}')
        for document, words in ALL
        if tuple(words[: len(start)]) == start and len(words) > len(start)
    ]


@pytest.mark.parametrize('words', of('make'))
def test_make_has_the_target_and_the_variables(words: list[str]) -> None:
    given = [each for each in words[1:] if '=' in each]
    assert {each.partition('=')[0] for each in given} <= VARIABLES
    for path in re.findall(r'[\w./]+/test_\w+\.py', ' '.join(given)):
        assert (ROOT / path).exists(), path
    done = subprocess.run(
        ['make', '-n', *words[1:], 'IN_WORKSPACE=:'], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize('words', of('make', 'ctl'))
def test_rcs_ctl_accepts_the_line(words: list[str]) -> None:
    for each in words[2:]:
        name, _, line = each.partition('=')
        if name == 'ARGS' and line != '...':
            parse(shlex.split(line))


@pytest.mark.parametrize('words', of('ros2', 'service', 'call'))
def test_the_service_has_the_fields_of_the_request(words: list[str]) -> None:
    service, kind, request = words[3], words[4], yaml.safe_load(' '.join(words[5:])) or {}
    assert kind == f'evgp_rcs_msgs/srv/{SERVICES[service]}'
    message = getattr(srv, SERVICES[service]).Request()

    def fill(target: Any, fields: dict[str, Any]) -> None:
        for field, value in fields.items():
            if isinstance(value, dict):
                fill(getattr(target, field), value)
            else:
                setattr(target, field, value)  # refuses a wrong name or type

    fill(message, request)


@pytest.mark.parametrize('words', [*of('ros2', 'run'), *of('ros2', 'launch')])
def test_the_package_has_the_program_or_launch_file(words: list[str]) -> None:
    package, name = words[2], words[3]
    if (ROOT / 'src' / package).exists():
        lib, launch = ROOT / 'install' / package / 'lib' / package, ROOT / 'src' / package
        assert (lib / name).exists() or (launch / 'launch' / name).exists()


@pytest.mark.parametrize('words', of('setup/in-workspace'))
def test_what_runs_in_the_workspace_is_there(words: list[str]) -> None:
    for word in words[1:]:
        if word.startswith(('install/', 'src/')):
            assert (ROOT / word).exists()
        if words[words.index(word) - 1] == '-m':
            assert importlib.util.find_spec(word) is not None
