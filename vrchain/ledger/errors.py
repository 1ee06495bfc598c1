"""The ledger's own errors. Each refusal has its kind, so that a caller can tell them apart."""

from typing import Any

from vrchain.errors import LedgerError


class EncodingError(LedgerError):
    """Bytes are not the canonical encoding of what was expected."""


class TooLargeError(LedgerError):
    """A record or payload is larger than the ledger takes."""


class RecordError(LedgerError):
    """A field of a record has a shape or value that is not allowed."""


class KeyFileError(LedgerError):
    """A signing key cannot be read or must not be written there."""


class PayloadFileError(LedgerError):
    """A file to be published cannot be read."""


class InvalidError(LedgerError):
    """A block or record that the chain refuses, whoever asks and whenever."""


class BrokenLinkError(InvalidError):
    """A block does not follow the head, or a transaction not its robot's previous one."""


class TimeOrderError(InvalidError):
    """A timestamp lies before one that it must not precede."""


class UnknownMemberError(InvalidError):
    """The name is not a member of this ledger."""


class ExpelledMemberError(UnknownMemberError):
    """The name was a member's until the operator expelled it; it never comes back."""


class DuplicateMemberError(InvalidError):
    """The name is a member of this ledger already."""


class WrongLedgerError(InvalidError):
    """A record was signed for another ledger."""


class ReplayError(InvalidError):
    """A sequence number was used before."""


class EquivocationError(InvalidError):
    """A robot signed two transactions with one number. Both, ``SignedRecord``, are the evidence."""

    def __init__(self, message: str, first: Any, second: Any) -> None:
        super().__init__(message)
        self.first, self.second = first, second


class SequenceGapError(InvalidError):
    """A sequence number skips one or more."""


class SignatureError(InvalidError):
    """A signature does not hold for the signer's public key."""


class RecordListError(InvalidError):
    """A block's list of records is not that of the records that came with it."""


class NewestError(InvalidError):
    """A block's table of newest transactions is not what its records make it."""


class PayloadDigestError(InvalidError):
    """A payload or landmark record is not the one that its transaction names."""


class DropError(InvalidError):
    """A drop names a blob of some robot's newest transaction."""


class ProofError(InvalidError):
    """A proof does not lead from the transaction to the known head."""


class AdmissionError(LedgerError):
    """What may be valid is not taken in here and now; see ``admission``."""


class DuplicateError(AdmissionError):
    """The very transaction is in the ledger, or waits for its block: its sender may go on."""


class InputLimitError(AdmissionError):
    """Input that nobody has verified yet is larger than is taken from strangers."""


class QueueFullError(AdmissionError):
    """Too many transactions, or too many bytes, wait for their block already."""


class ClockSkewError(AdmissionError):
    """A timestamp is too far ahead of the present time."""


class RateLimitError(AdmissionError):
    """The robot has published more than its rate allows."""


class StorageError(LedgerError):
    """The ledger's folder cannot be read or written."""


class NotALedgerError(StorageError):
    """The folder holds no ledger, or one of another format."""


class ReplacedError(StorageError):
    """The ledger's folder or files are not those any more that were opened."""


class LedgerExistsError(StorageError):
    """A ledger, or something else, is already where a new one should go."""


class LedgerBusyError(StorageError):
    """Another process is writing and did not finish in time."""


class ReadOnlyError(StorageError):
    """The ledger was opened for reading only."""


class AccessError(StorageError):
    """The permissions of the ledger's folder or files forbid it."""


class StorageFullError(StorageError):
    """No room is left on the disk."""


class DamagedError(StorageError):
    """What is stored is not what was written."""


class NotFoundError(StorageError):
    """The ledger holds no such transaction, block or payload."""


class DroppedError(NotFoundError):
    """The blob was dropped on purpose; the operator signed that."""


class LogError(LedgerError):
    """A log that a ledger shares with others does not serve."""


class OvertakenError(LogError):
    """Another block was appended first: take it in, and make the block anew."""


class UnavailableError(LogError):
    """No server answers, or too few for a majority. What waits stays in the outbox."""


class ClusterError(LogError):
    """The servers answer but cannot serve: too old, without JetStream, full, not permitted."""


class GapError(LogError):
    """What the log gives does not go on from the chain: a block is missing or another one."""


class RefusedError(LedgerError):
    """An offer never comes into a block; it lies in the folder ``outbox/refused``."""


class NotSettledError(LedgerError):
    """The robot may have signed what this folder does not know: it has to read the chain first."""


class ForkError(InvalidError):
    """Two blocks of one height, both signed by a member: ``first`` and ``second`` convict it."""

    def __init__(self, message: str, first: Any, second: Any) -> None:
        super().__init__(message)
        self.first, self.second = first, second
