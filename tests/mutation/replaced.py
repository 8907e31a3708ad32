"""Brings a mutant into a process: as the text of a module that is yet to be imported, or into its functions.

Importing the tick and the tests takes seconds, so a mutant inside a function is put into the function object
where all is imported already. What is computed at import, such as a constant, needs the import.
"""

from __future__ import annotations

import gc
import sys
from collections import defaultdict
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from types import CodeType, FunctionType

from tests.mutation.mutants import MUTATED, ROOT

#: Functions by path of their module, qualified name and first line.
Functions = dict[tuple[str, str, int], list[FunctionType]]


class _Loader(SourceFileLoader):
    """Finds and loads one module from another text."""

    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self._source = source

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        return spec_from_file_location(name, self.path, loader=self) if name == self.name else None

    def get_code(self, fullname: str) -> CodeType:
        return _compiled(self._source, self.path)


def import_from(module: str, source: str) -> None:
    """Let a module of the tick be imported from a text."""
    name = ".".join((MUTATED / module).with_suffix("").parts)
    assert name not in sys.modules
    sys.meta_path.insert(0, _Loader(name, str(ROOT / MUTATED / module), source))


def functions_of_the_tick() -> Functions:
    """All functions of the tick that there are in this process."""
    found: Functions = defaultdict(list)
    folder = str(ROOT / MUTATED)
    for each in gc.get_objects():
        if isinstance(each, FunctionType) and each.__code__.co_filename.startswith(folder):
            code = each.__code__
            found[code.co_filename, code.co_qualname, code.co_firstlineno].append(each)
    return found


def patch(functions: Functions, module: str, source: str) -> None:
    """Give the functions of a module the code of a text that differs inside functions only."""
    path = str(ROOT / MUTATED / module)
    codes = [_compiled(source, path)]
    while codes:
        code = codes.pop()
        codes += [each for each in code.co_consts if isinstance(each, CodeType)]
        for function in functions.get((path, code.co_qualname, code.co_firstlineno), ()):
            if code.co_freevars == function.__code__.co_freevars:
                function.__code__ = code


def _compiled(source: str, path: str) -> CodeType:
    code: CodeType = compile(source, path, "exec", dont_inherit=True)
    return code
