"""SQLite file of one kind -> its tables, open for one process at a time; errors as sentences."""

import hashlib
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from startrack.io.reading import regular_file
from startrack.io.saving import forget_owner, note_owner, owner

# Runs one statement with its values, in a transaction.
Execute = Callable[..., sqlite3.Cursor]
# The table of `Database.keep` and `kept`.
STEPS = 100_000  # of SQLite's machine between two looks at signals: some milliseconds
ROWS = """
CREATE TABLE IF NOT EXISTS rows (
    key BLOB NOT NULL, number INTEGER NOT NULL, data BLOB NOT NULL, checksum BLOB NOT NULL,
    PRIMARY KEY (key, number)
) WITHOUT ROWID;
"""


class FileKind(NamedTuple):
    """Properties that files of one kind have in common.

    what         expected kind of file, for error messages: "campaign store"
    application  number in the file's header that marks the kind
    tables       CREATE TABLE IF NOT EXISTS statements, each ended by ";"
    version      of the tables, in the file's header
    """

    what: str
    application: int
    tables: str = ROWS
    version: int = 0


class Database:
    """Open SQLite file.

    Each `transaction` is committed to a write-ahead log: a process that is killed at any instant
    leaves a file with all completed transactions. A loss of power may lose the last seconds, but
    never the file.
    """

    def __init__(
        self,
        path: Path | None,
        kind: FileKind,
        create: bool = True,
        begin: Callable[[Execute], None] | None = None,
    ):
        """Open a file, or begin one.

        path    None keeps it in memory
        create  whether to create a missing file
        begin   writes the first rows, in the transaction that makes the tables

        Raises  ValueError if the file is damaged, of another kind or version, or missing and
                not to be created; OSError if it cannot be opened or another process uses it.
        """
        self.path = path
        self.kind = kind
        with self._translated_errors():
            if path and create:
                path.parent.mkdir(parents=True, exist_ok=True)
            if path and (not create or (path.exists() and not path.is_dir())):
                try:
                    regular_file(path, f"a {kind.what}")
                except FileNotFoundError as error:
                    raise ValueError(str(error)) from None
            self._base = sqlite3.connect(path or ":memory:", timeout=0, isolation_level=None)
            # The file may be from anybody: code that its schema calls is not trusted. A long query
            # of a damaged file lets Python look at signals, whose exception ends it.
            self._base.execute("PRAGMA trusted_schema = OFF")
            self._base.set_progress_handler(_look_at_signals, STEPS)
            # Readers check invalid text.
            self._base.text_factory = lambda data: data.decode("utf-8", "replace")
            try:
                self._open(create, begin)
            except BaseException:
                self._base.close()
                raise
            if path:
                note_owner(path)

    def _open(self, create: bool, begin: Callable[[Execute], None] | None) -> None:
        ask = self._base.execute
        # The lock is the system's, so that it ends with the process however that ends.
        ask("PRAGMA locking_mode = EXCLUSIVE")
        begun = ask("SELECT 1 FROM sqlite_master LIMIT 1").fetchone() is not None
        if begun:
            self._must_be_of_this_kind()
        elif not create:
            raise ValueError(f"{self.path} must be a {self.kind.what}, but is empty")
        ask("PRAGMA journal_mode = WAL")
        ask("PRAGMA synchronous = NORMAL")
        with self.transaction("BEGIN EXCLUSIVE") as execute:
            if not create:
                return
            for statement in self.kind.tables.split(";"):
                execute(statement)
            if not begun:
                if begin:
                    begin(execute)
                execute(f"PRAGMA application_id = {self.kind.application}")
                execute(f"PRAGMA user_version = {self.kind.version}")

    def _must_be_of_this_kind(self) -> None:
        (application,) = self._base.execute("PRAGMA application_id").fetchone()
        if application != self.kind.application:
            raise ValueError(f"{self.path} must be a {self.kind.what}, but is another database")
        self._refuse_code()
        (version,) = self._base.execute("PRAGMA user_version").fetchone()
        if version != self.kind.version:
            raise ValueError(
                f"{self.path} must be a {self.kind.what} of format {self.kind.version}, got format "
                f"{version}; begin another file"
            )

    def _refuse_code(self) -> None:
        """Refuse code that runs automatically when tables are read or written: views, triggers and
        others.

        The tables must have the form of this kind of file, without further columns or rules.
        """
        query = "SELECT type, name, sql FROM sqlite_master"
        with closing(sqlite3.connect(":memory:")) as model:
            model.executescript(self.kind.tables)
            known = set(model.execute(query))
        for kind, name, text in self._base.execute(query):
            if (kind, name, text) not in known:
                raise ValueError(
                    f"{self.path} must be a {self.kind.what} with its own tables alone, but has "
                    f"the {kind} {str(name)[:80]!r} of another making"
                )

    @contextmanager
    def transaction(self, begin: str = "BEGIN") -> Iterator[Execute]:
        """Context whose statements are committed together, or, where it raises, not at all."""
        with self._translated_errors():
            self._base.execute(begin)
            try:
                yield self._base.execute
                self._base.execute("COMMIT")
            except BaseException:
                if self._base.in_transaction:
                    self._base.execute("ROLLBACK")
                raise

    def read(self, query: str, *values: Any) -> list[Any]:
        """All rows of a query."""
        with self._translated_errors():
            return self._base.execute(query, values).fetchall()

    def keep(self, key: bytes, number: int, data: bytes) -> None:
        """Commit a row of a file of ROWS, with a checksum of all of it."""
        with self.transaction() as execute:
            row = (key, number, data, _checksum(key, number, data))
            execute("INSERT INTO rows VALUES (?, ?, ?, ?)", row)

    def kept(self, key: bytes) -> list[tuple[int, bytes]]:
        """Number and data of the rows of a key, in order.

        Raises  ValueError, with the file and the row, where one is not as it was written.
        """
        query = "SELECT number, data, checksum FROM rows WHERE key = ? ORDER BY number"
        rows = self.read(query, key)
        for number, data, checksum in rows:
            if checksum != _checksum(key, number, data):
                raise ValueError(
                    f"{self.path} is damaged: row {number} of {key.hex()} is not as it was "
                    "written; delete the file, and the same command does it all again"
                )
        return [(number, data) for number, data, _ in rows]

    def close(self) -> None:
        """Merge the log into the file."""
        if self.path:
            forget_owner(self.path)
        self._base.close()

    @contextmanager
    def _translated_errors(self) -> Iterator[None]:
        """Raise ValueError where the file is another kind or damaged, OSError where it cannot be
        used."""
        try:
            yield
        except sqlite3.DatabaseError as error:
            code = getattr(error, "sqlite_errorname", "")
            if code == "SQLITE_INTERRUPT":  # what the handler of a signal raised became this
                raise KeyboardInterrupt from None
            if code.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
                other = owner(self.path) if self.path else ""
                raise OSError(f"{self.path} is in use by another process{other}") from None
            if code.startswith("SQLITE_NOTADB"):
                raise ValueError(
                    f"{self.path} must be a {self.kind.what}, but is not one"
                ) from None
            # Errors of correct statements, for missing tables or wrong contents.
            odd = code in ("", "SQLITE_ERROR", "SQLITE_SCHEMA", "SQLITE_MISMATCH", "SQLITE_FORMAT")
            if code.startswith("SQLITE_CORRUPT") or odd or isinstance(error, sqlite3.DataError):
                raise ValueError(f"{self.path} is damaged: {error}") from None
            raise OSError(
                f"{self.path} cannot be written: {error}; what it held is whole"
            ) from None


def _look_at_signals() -> int:
    """Do nothing: Python runs handlers of signals at this call; what they raise ends a query."""
    return 0


def _checksum(key: bytes, number: Any, data: Any) -> bytes:
    """Checksum of a row; that of no row where the columns hold something else."""
    if not isinstance(data, bytes):
        return b""
    return hashlib.blake2b(
        b"%r %b\n%b" % (number, key.hex().encode(), data), digest_size=8
    ).digest()
