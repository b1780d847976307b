# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Imports Qt 6 for Python from either of its two bindings.

The project's own set-up installs PySide6. Ubuntu 24.04, on which ROS 2 Jazzy runs, has PyQt6 but
not PySide6. The two use the same names, except for signals. If both are installed, the variable
QT_API can choose one, with `pyside6` (the default) or `pyqt6`.

:raises ImportError: if neither is installed, or a library that it needs is missing.
"""

import builtins
import os

_python_import = builtins.__import__
if os.environ.get('QT_API', '').lower() == 'pyqt6':
    from PyQt6 import QtCore, QtGui, QtWidgets
else:
    try:
        from PySide6 import QtCore, QtGui, QtWidgets
    except ModuleNotFoundError:
        from PyQt6 import QtCore, QtGui, QtWidgets

# PySide6 puts its own in place, for `from __feature__ import`. That one reads the source of every
# module, and takes longer for each `import` inside a message's class than the rest of the class.
builtins.__import__ = _python_import

Signal = QtCore.Signal if hasattr(QtCore, 'Signal') else QtCore.pyqtSignal

__all__ = ['QtCore', 'QtGui', 'QtWidgets', 'Signal']
