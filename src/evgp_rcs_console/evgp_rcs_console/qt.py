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
Qt for Python, whichever of its two bindings is there.

PySide6 comes with the project's own set-up. Ubuntu 24.04, and with it ROS 2 Jazzy, has PyQt6 and
no PySide6. Both bind Qt 6 with the same names, but for the one of signals. QT_API (`pyside6` or
`pyqt6`) chooses where both are there.

:raises ImportError: if there is neither.
"""

import os

if os.environ.get('QT_API', '').lower() == 'pyqt6':
    from PyQt6 import QtCore, QtGui, QtWidgets
else:
    try:
        from PySide6 import QtCore, QtGui, QtWidgets
    except ImportError:
        from PyQt6 import QtCore, QtGui, QtWidgets

Signal = QtCore.Signal if hasattr(QtCore, 'Signal') else QtCore.pyqtSignal

__all__ = ['QtCore', 'QtGui', 'QtWidgets', 'Signal']
