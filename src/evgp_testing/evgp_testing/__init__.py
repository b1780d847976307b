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

"""
The parts of a race, for tests and the demonstration: all real, none a mock.

With the workspace sourced, pytest finds the fixtures of ``evgp_testing.fixtures`` by itself, in a
team's own tests too.
Each part owns its process or its context, executor and domain, and gives everything back
in ``close``; each can be used in a ``with`` statement.
"""
