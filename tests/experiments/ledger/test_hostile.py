"""A hostile member and a dishonest maker on real servers: what stops each attack."""

import re

from clusters import skip_without_servers

from vrchain.experiments.ledger.hostile import attacks


def test_every_attack_is_stopped_and_by_whom() -> None:
    skip_without_servers()
    table = attacks(seed=1)
    print(f"\n{table[['attack', 'stopped_by']].to_string(index=False)}")
    stopped = dict(zip(table.attack, table.stopped_by, strict=True))
    assert len(stopped) == 23
    assert "nothing" not in stopped.values()
    refused = [name for name, by in stopped.items() if by == "servers: permission"]
    assert len(refused) == 9
    said = dict(zip(table.attack, table.said, strict=True))
    assert "do not permit R1 to publish to block" in said["write a block itself"]
    # a server that hangs up may be heard before what it says
    assert re.search("let nobody in|no answer from", said["come in without a key"])
    assert "are full" in said["flood its own subject"]
    assert {name: by for name, by in stopped.items() if name not in refused} == {
        "come in without a key": "servers: key",
        "come in with another key": "servers: key",
        "flood its own subject": "servers: limit of offers that wait",
        "as operator of servers, delete a block": "servers: deny_delete",
        "have an answer written as a block": "servers: account of its own",
        "have an answer offered in another's place": "servers: account of its own",
        "have an answer delete the chain": "servers: account of its own",
        "listen to another's answers": "servers: subscription not permitted",
        "send what is too large": "servers: TooLargeError",
        "offer garbage": "maker: EncodingError",
        "sign in another's name": "maker: UnknownMemberError",
        "sign two with one number": "maker: EquivocationError",
        "as maker, a block that does not follow": "followers: GapError",
        "as maker, two blocks at one height": "followers: ForkError, 2 blocks kept as evidence",
    }
