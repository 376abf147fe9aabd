"""plcSim as a pair."""
from sim import Sim


class PairSim(Sim):
    """Two PLCs in one process, on 127.0.0.1 and 127.0.0.2."""

    @property
    def ports(self):
        return [int(next(line for line in self.lines if f" {name} listening on " in line).rsplit(":", 1)[1])
                for name in ("FIRST", "SECOND")]
