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
The rehearsal: a race with simulated karts and incidents, for officials and for teams.

``plan`` is what the YAML file says, ``field`` the karts on the track, ``incidents`` what can
happen and what a good official does, ``score`` the sheet. These are pure. ``event`` plays them
with the real race control over TCP. ``demo`` is a rehearsal that runs by itself.
"""
