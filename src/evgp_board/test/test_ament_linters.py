# Copyright 2026 EVGP race control contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""ament's linters on this package; they come with an installed ROS."""

from __future__ import annotations

import pathlib

import pytest

LINTERS = ('copyright', 'flake8', 'pep257', 'xmllint')
WHY_NOT = "ament's linters are not installed: they come with ROS, not with its wheels"


@pytest.mark.parametrize('linter', LINTERS)
def test_the_linter_has_nothing_to_say(linter: str) -> None:
    module = pytest.importorskip(f'ament_{linter}.main', reason=WHY_NOT)
    assert module.main(argv=[str(pathlib.Path(__file__).parents[1])]) == 0
