# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

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
