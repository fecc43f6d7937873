"""Run the pending mutants of a cosmic-ray session, each in a fork of one warm pytest process.

`python .ci/mutation_test.py mutation.toml mutation.sqlite` goes on where it was interrupted, in
random order; with `--again` it runs the survivors again. The session is made by `cosmic-ray init`
and `cr-filter-operators` from mutation.toml.

All tests run once, with coverage of each. Then each mutant is a fork that runs the tests that
execute its statement, the fastest first, until one fails. A change in the body of a function
replaces the code of that function; after any other change the module and all that import it are
imported again. No file is changed.
"""

import ast
import difflib
import os
import resource
import shlex
import sys
import time
import tomllib
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from importlib.util import spec_from_loader
from pathlib import Path
from types import CodeType, FunctionType

import cosmic_ray.plugins
import coverage
import grimp
import pytest
from _pytest.runner import runtestprotocol
from cosmic_ray.ast import get_ast
from cosmic_ray.mutating import MutationVisitor
from cosmic_ray.work_db import WorkDB, WorkResultStorage, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkerOutcome, WorkResult

CONFIG = tomllib.loads(Path(sys.argv[1]).read_text())
TESTS = shlex.split(CONFIG["cosmic-ray"]["test-command"])[3:]
TIMEOUT_S = int(CONFIG["cosmic-ray"]["timeout"])
PLAIN_OPTIONS = ("-q", "-x", "-s", "-o", "addopts=", "--import-mode=importlib")
HERE = Path.cwd()


class Source:
    """A module, its statements, and which tests run them."""

    def __init__(self, path: Path, data: coverage.CoverageData, graph: grimp.ImportGraph) -> None:
        self.path = path
        self.name = ".".join(path.with_suffix("").parts)
        self.code = path.read_text()
        self.tree = ast.parse(self.code)
        self.downstream = {self.name, *graph.find_downstream_modules(self.name)}
        self._tests = data.contexts_by_lineno(str(path.resolve()))
        importers = graph.find_modules_that_directly_import(self.name)
        files = [path, *(Path(*each.split(".")).with_suffix(".py") for each in importers)]
        contexts = (data.contexts_by_lineno(str(each.resolve())).values() for each in files)
        self.tests = {test for found in contexts for tests in found for test in tests if test}
        """that execute a line of this module or of one that imports it"""

    def is_annotation(self, line: int, column: int) -> bool:
        for node in ast.walk(self.tree):
            for name in ("annotation", "returns"):
                note = getattr(node, name, None)
                if note is not None and _contains(note, line, column):
                    return True
        return False

    def tests_at(self, line: int) -> set[str]:
        """Tests that execute the innermost statement at this line."""
        found = None
        for node in ast.walk(self.tree):
            if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or 0):
                found = node  # breadth first: the last one is the innermost
        assert found is not None
        body = getattr(found, "body", None)
        last = body[0].lineno - 1 if body else found.end_lineno or 0
        lines = range(found.lineno, max(last, found.lineno) + 1)
        return {test for each in lines for test in self._tests.get(each, ()) if test}

    def function_at(self, line: int) -> str | None:
        """Qualified name of the outermost function with this line in its body."""
        for node, prefix in _functions(self.tree.body, ""):
            if node.body[0].lineno <= line <= (node.end_lineno or 0):
                return prefix + node.name
        return None


def _contains(node: ast.AST, line: int, column: int) -> bool:
    begin = (node.lineno, node.col_offset)  # type: ignore[attr-defined]
    end = (node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]
    return begin <= (line, column) < end


def _functions(body: list[ast.stmt], prefix: str) -> Iterator[tuple[ast.FunctionDef, str]]:
    for node in body:
        if isinstance(node, ast.FunctionDef):
            yield node, prefix
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node.body, f"{prefix}{node.name}.")


def _code_of(code: CodeType, name: str) -> CodeType | None:
    if code.co_qualname == name:
        return code
    inner = (_code_of(each, name) for each in code.co_consts if isinstance(each, CodeType))
    return next((each for each in inner if each is not None), None)


def _function(module: str, name: str) -> FunctionType | None:
    found = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, "__dict__", {}).get(part)
    found = getattr(found, "fget", found)
    return found if isinstance(found, FunctionType) else None


class MutatedLoader(SourceFileLoader):
    """Loads a module from its mutated source."""

    def __init__(self, name: str, path: Path, code: str) -> None:
        super().__init__(name, str(path))
        self.mutated = code

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.mutated, self.path, "exec")

    def find_spec(self, fullname: str, *_: object) -> object:
        return spec_from_loader(fullname, self) if fullname == self.name else None


class Selected:
    """Plugin: runs these tests, in this order."""

    def __init__(self, tests: list[str]) -> None:
        self.tests = tests

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        rank: dict[str, int] = {}  # of the functions: the mutant may have changed a parameter
        for test in self.tests:
            rank.setdefault(test.split("[")[0], len(rank))
        items[:] = [item for item in items if item.nodeid.split("[")[0] in rank]
        items.sort(key=lambda item: rank[item.nodeid.split("[")[0]])


class Mutation:
    """Plugin: runs all tests once, then the mutants."""

    def __init__(self, session_file: str) -> None:
        self.session_file = session_file

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self.items = {item.nodeid: item for item in session.items}
        self.times_s: dict[str, float] = {}
        paths = [Path(each) for each in CONFIG["cosmic-ray"]["module-path"]]
        measured = [f"{each}/*" if each.is_dir() else str(each) for each in paths]
        cov = coverage.Coverage(data_file=None, include=measured)
        cov.start()
        for item, following in zip(session.items, [*session.items[1:], None], strict=True):
            cov.switch_context(item.nodeid)
            begun_s = time.process_time()
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            self.times_s[item.nodeid] = time.process_time() - begun_s
        cov.stop()
        if session.testsfailed:
            raise session.Interrupted("the tests fail without a mutant")
        data = cov.get_data()
        self.others = set(self.items) - data.measured_contexts()
        graph = grimp.build_graph("rt_controller", "sim_bridge", cache_dir=None)
        sources: dict[Path, Source] = {}
        with use_db(self.session_file, WorkDB.Mode.open) as database:
            for item in database.pending_work_items:
                (spec,) = item.mutations
                path = spec.module_path
                if path not in sources:
                    sources[path] = Source(path, data, graph)
                database.set_result(item.job_id, self._judge(spec, sources[path]))
        return True

    def _judge(self, spec: MutationSpec, source: Source) -> WorkResult:
        line, column = spec.start_pos
        if source.is_annotation(line, column):
            return WorkResult(WorkerOutcome.SKIPPED, output="annotation")
        operator = cosmic_ray.plugins.get_operator(spec.operator_name)(**spec.operator_args)
        visitor = MutationVisitor(spec.occurrence, operator)
        mutated = visitor.walk(get_ast(source.code)).get_code()
        texts = (source.code.splitlines(), mutated.splitlines())
        diff = "\n".join(difflib.unified_diff(*texts, str(source.path), "mutant", n=0, lineterm=""))
        function = source.function_at(line)
        tests = source.tests_at(line) if function else set()
        if not tests:  # runs at the import
            function, tests = None, source.tests | self.others
        tests_in_order = sorted(tests, key=lambda test: self.times_s[test])
        sys.stdout.flush()
        begun_s = time.monotonic()
        child = os.fork()
        if child == 0:
            self._run(source, function, mutated, tests_in_order)
        _, status = os.waitpid(child, 0)
        is_killed = status != 0
        print(
            "killed  " if is_killed else "SURVIVED",
            f"{spec.module_path}:{line} {spec.operator_name} {len(tests)} tests",
            f"{time.monotonic() - begun_s:.2f} s" + (" (reloaded)" if not function else ""),
            flush=True,
        )
        return WorkResult(
            WorkerOutcome.NORMAL,
            output=f"status {status}",
            test_outcome=TestOutcome.KILLED if is_killed else TestOutcome.SURVIVED,
            diff=diff,
        )

    def _run(self, source: Source, function: str | None, mutated: str, tests: list[str]) -> None:
        """Of the child: ends with 0 if no test fails."""
        result = 3
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (TIMEOUT_S, TIMEOUT_S))
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, 1)
            os.dup2(null, 2)
            found = _function(source.name, function) if function else None
            if found is None or function is None:
                result = self._run_again(source, mutated, tests)
            else:
                code = _code_of(compile(mutated, str(source.path.resolve()), "exec"), function)
                assert code is not None
                found.__code__ = code
                result = self._run_warm(tests)
        finally:
            os._exit(result)

    def _run_warm(self, tests: list[str]) -> int:
        for test in tests:
            reports = runtestprotocol(self.items[test], log=False, nextitem=None)
            if any(report.failed for report in reports):
                return 1
        return 0

    def _run_again(self, source: Source, mutated: str, tests: list[str]) -> int:
        for name, module in list(sys.modules.items()):
            path = getattr(module, "__file__", None) or ""
            if name in source.downstream or path.startswith(str(HERE / "tests")):
                del sys.modules[name]
                parent, _, last = name.rpartition(".")
                if hasattr(sys.modules.get(parent), last):
                    delattr(sys.modules[parent], last)
        sys.meta_path.insert(0, MutatedLoader(source.name, source.path.resolve(), mutated))
        files = dict.fromkeys(test.split("::")[0] for test in tests)
        os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # takes longer than most tests
        code = pytest.main([*PLAIN_OPTIONS, *files], plugins=[Selected(tests)])
        return 0 if code in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED) else 1


def run(session_file: str, is_again: bool) -> int:
    """Run the pending mutants, or the survivors again; return the exit code of pytest."""
    if is_again:
        database = WorkDB(session_file, WorkDB.Mode.open)
        with database._session_maker.begin() as session:
            survived = WorkResultStorage.test_outcome == TestOutcome.SURVIVED
            session.query(WorkResultStorage).filter(survived).delete()
        database.close()
    return pytest.main([*TESTS, "-s"], plugins=[Mutation(session_file)])


if __name__ == "__main__":
    sys.exit(run(sys.argv[2], is_again=sys.argv[3:] == ["--again"]))
