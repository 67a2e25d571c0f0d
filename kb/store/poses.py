"""The measurement knowledge base in the same database as the MACROPs: one document for each measurement, tool and station."""

from collections.abc import Collection, Mapping

from sqlalchemy import delete, insert, select

from cellwright.kb.store.engines import POSES, lock, transaction
from cellwright.kb.store.opening import Database
from cellwright.kb.store.outlines import chunks
from cellwright.kb.store.schema import poses

Key = tuple[str, str, str]  # measurement, tool, station


class PoseStore(Database):
    """The kept poses in a database, given by a file or a URL. Raises `InvalidInput` if the database reports an error."""

    def of(self, domain: str, problem: str) -> dict[Key, str]:
        """The documents of a problem."""
        mine = (poses.c.domain == domain) & (poses.c.problem == problem)
        asked = select(poses.c.measurement, poses.c.tool, poses.c.station, poses.c.document).where(mine)
        with transaction(self._engine, self.target) as connection:
            return {(row[0], row[1], row[2]): row[3] for row in connection.execute(asked)}

    def keep(
        self,
        domain: str,
        problem: str,
        documents: Mapping[Key, str],
        measurements: Collection[str] | None = None,
    ) -> None:
        """Put documents in the place of all that are kept for a problem, or for some of its measurements."""
        mine = (poses.c.domain == domain) & (poses.c.problem == problem)
        some = [None] if measurements is None else chunks(sorted(measurements))
        rows = [
            {
                "domain": domain,
                "problem": problem,
                "measurement": m,
                "tool": t,
                "station": s,
                "document": text,
            }
            for (m, t, s), text in sorted(documents.items())
        ]
        with transaction(self._engine, self.target, writes=True) as connection:
            lock(connection, POSES)
            for names in some:
                own = mine if names is None else mine & poses.c.measurement.in_(names)
                connection.execute(delete(poses).where(own))
            if rows:
                connection.execute(insert(poses), rows)
