"""Texts of alarms over EtherNet/IP that other tests do not provoke."""
from eipplant import rec


def test_texts(plant):
    """a text too long, a bit that the type has not, bits of a real number: each is told in AMSG"""
    plant.tags("udt S5 string 5", "tag Short S5", "tag N INT = 3", "tag R REAL = 1.5")
    plant.records(rec("stringout", "text", "Short S 0.05"), rec("bi", "bit", "N B 20 S 0.05"),
                  rec("bo", "real", "R B 3 S 0.05"), rec("stringin", "shown", "Short S 0.05"))
    plant.ioc.wait_alarm("shown", "NO_ALARM")
    plant.ioc.put("text", "123456")
    plant.ioc.wait_alarm("text", "INVALID", "WRITE", "the text is too long for the tag")
    assert plant.tag("Short").strip('"') == ""
    plant.ioc.put("text", "12345")
    plant.ioc.wait_alarm("text", "NO_ALARM")
    plant.ioc.wait_alarm("bit", "INVALID", "READ", "INT has bits 0 to 15", ask=True)
    plant.ioc.put("real", 1)
    plant.ioc.wait_alarm("real", "INVALID")


def test_bits_across(plant):
    """bits that an index counts, over the border of two DINTs, where the elements are larger: said in whole words"""
    plant.tags("tag L LINT[4]", "tag N DINT = 1")
    plant.records(rec("mbbi", "over", "L[28] S 0.05", "NOBT=8", "ONVL=1"), rec("longin", "n", "N S 0.05"))
    plant.ioc.wait_value("n", 1)
    plant.ioc.wait_alarm("over", "INVALID", "READ", "an element has these bits: E in link", ask=True)


def test_not_read(plant):
    """before its first value a tag that is read seldom says so"""
    plant.tags("tag A DINT = 5", "tag B DINT = 6")
    plant.records(rec("longin", "a", "A S 0.05"))
    plant.ioc.wait_value("a", 5)
    plant.sim.command("etherip slow 1000")
    plant.ioc.put("a.INP", "@P B S 60")
    plant.ioc.wait_alarm("a", "INVALID", "READ", "the tag has not been read yet", ask=True)
    plant.sim.command("etherip normal")
    plant.ioc.wait_alarm("a", "NO_ALARM", ask=True)
