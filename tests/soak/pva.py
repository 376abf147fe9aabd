"""A client by PV Access, beside those by Channel Access. Without p4p, or with a Base that has no PVA, there is none."""
import logging
import time

import client

try:
    from p4p.client.thread import Context
except ImportError:
    Context = None
if "registerStartPVAServer" not in (client.TOP / "dbd/s7plcIoc.dbd").read_text():
    Context = None


logging.getLogger("p4p").setLevel(logging.CRITICAL)  # it tells of values that come while a monitor ends


class Pva:
    """Monitors of one IOC after the other, and gets. Values are told as heard(name, value, severity, time)."""

    def __init__(self, heard):
        self.heard = heard
        self.subscriptions = []
        self.context = Context and Context("pva", useenv=False, conf={
            "EPICS_PVA_ADDR_LIST": "127.0.0.1", "EPICS_PVA_AUTO_ADDR_LIST": "NO",
            "EPICS_PVA_BROADCAST_PORT": str(client.PVA_UDP), "EPICS_PVA_SERVER_PORT": str(client.PVA_PORT)})

    def listen(self, prefix, names):
        if self.context:
            self.subscriptions = [self.context.monitor(prefix + name, self.hears(name)) for name in names]

    def hears(self, name):
        def update(value):
            self.heard(name, plain(value), value.raw.alarm.severity, time.monotonic())
        return update

    def get(self, name):
        """(value, severity), None: no answer within a second."""
        try:
            value = self.context.get(name, timeout=1.0)
        except TimeoutError:
            return None
        return plain(value), value.raw.alarm.severity

    def forget(self):
        for subscription in self.subscriptions:
            subscription.close()
        self.subscriptions = []

    def close(self):
        self.forget()
        if self.context:
            self.context.close()


def plain(value):
    value = value.raw.value
    return value.tolist() if hasattr(value, "tolist") else value
