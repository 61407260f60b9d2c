"""
Generate LLVM IR of a handler by which XLA calls a lane kernel for a batch.

XLA calls ``XLA_FFI_Error *handler(XLA_FFI_CallFrame *)`` with buffers in host memory.
Their layout is that of ``xla/ffi/api/c_api.h``, major version 0: offsets in bytes below
are of its structures. The operands are the arguments of the kernel, each with the
entries of one state, which all share, or those of every state; then the bytes of the
kernel's shared parameters. Arguments and result are float64, or float32, which is
converted. A state with an argument or a result that is not finite, or a position that is
too large, has NaN in all of its result.
"""

from collections.abc import Sequence

from kane_dynamics.native.backends.llvm_math import literal
from kane_dynamics.native.backends.xla_support import SUPPORT
from kane_dynamics.native.machine_code.llvm import Address

HANDLER = 'handler'
MAJOR = 0  # of the version of XLA's interface whose layout is used
WORK = 2_000_000  # operations of a thread at least; some 0.3 ms

HEAD = """
define ptr @HANDLER(ptr %frame) {
start:
  %table = alloca [SLOTS x [ROW x i64]]
  %job = alloca [WORDS x i64]
  %extension.at = getelementptr i8, ptr %frame, i64 8
  %extension = load ptr, ptr %extension.at
  %plain = icmp eq ptr %extension, null
  br i1 %plain, label %execute, label %extended
extended:
  %kind.at = getelementptr i8, ptr %extension, i64 8
  %kind = load i32, ptr %kind.at
  %asked = icmp eq i32 %kind, 1
  br i1 %asked, label %describe, label %execute
describe:  ; XLA_FFI_Metadata: versions of the interface, and no traits
  %metadata.at = getelementptr i8, ptr %extension, i64 24
  %metadata = load ptr, ptr %metadata.at
  %major.at = getelementptr i8, ptr %metadata, i64 24
  store i32 MAJOR, ptr %major.at
  %minor.at = getelementptr i8, ptr %metadata, i64 28
  store i32 MINOR, ptr %minor.at
  %traits.at = getelementptr i8, ptr %metadata, i64 32
  store i32 0, ptr %traits.at
  br label %end
execute:
  %args.at = getelementptr i8, ptr %frame, i64 72
  %args = load ptr, ptr %args.at
  %rets.at = getelementptr i8, ptr %frame, i64 112
  %rets = load ptr, ptr %rets.at
  %result = load ptr, ptr %rets
  %result.data.at = getelementptr i8, ptr %result, i64 24
  %result.data = load ptr, ptr %result.data.at
  %dtype.at = getelementptr i8, ptr %result, i64 16
  %dtype = load i32, ptr %dtype.at
  %single = icmp eq i32 %dtype, 11
  %total = call i64 @entries(ptr %result)
  %count = sdiv i64 %total, SIZE
  %none = icmp eq i64 %count, 0
  br i1 %none, label %end, label %operands
operands:
"""

# Of one operand: its entries and its address.
OPERAND = """
  %argK.at = getelementptr ptr, ptr %args, i64 K
  %argK = load ptr, ptr %argK.at
  %argK.data.at = getelementptr i8, ptr %argK, i64 24
  %argK.data = load ptr, ptr %argK.data.at
  %argK.entries = call i64 @entries(ptr %argK)
  %argK.shared = icmp eq i64 %argK.entries, SIZE
  %argK.stride = select i1 %argK.shared, i64 0, i64 BYTES
  %before.NEXT = add i64 %before.K, %argK.entries
"""
# The last one, which is not converted.
PARAMETERS = """
  %argK.at = getelementptr ptr, ptr %args, i64 K
  %argK = load ptr, ptr %argK.at
  %argK.data.at = getelementptr i8, ptr %argK, i64 24
  %argK.data = load ptr, ptr %argK.data.at
  call void @put(ptr %table, i64 K, ptr %argK.data, i64 0)
"""
SCRATCH = """
  %before.all = add i64 %before.ARGUMENTS, %total
  %scratch.bytes = mul i64 %before.all, 8
  br i1 %single, label %allocate, label %place
allocate:
  %allocated = call ptr @malloc(i64 %scratch.bytes)
  %failed = icmp eq ptr %allocated, null
  br i1 %failed, label %nothing, label %place
nothing:  ; no memory
  %result.bytes = mul i64 %total, 4
  call void @llvm.memset.p0.i64(ptr %result.data, i8 -1, i64 %result.bytes, i1 false)
  br label %end
place:
  %scratch = phi ptr [null, %operands], [%allocated, %allocate]
"""
PLACE = """
  br i1 %single, label %widenK, label %placedK
widenK:
  %scratchK = getelementptr double, ptr %scratch, i64 %before.K
  call void @convert(ptr %argK.data, ptr %scratchK, i64 %argK.entries, i1 true)
  br label %placedK
placedK:
  %addressK = phi ptr [%argK.data, %FROM], [%scratchK, %widenK]
  call void @put(ptr %table, i64 K, ptr %addressK, i64 %argK.stride)
"""
RUN = """
  %scratch.result = getelementptr double, ptr %scratch, i64 %before.ARGUMENTS
  %address = select i1 %single, ptr %scratch.result, ptr %result.data
  call void @put(ptr %table, i64 LAST, ptr %address, i64 BYTES)
  %whole = sdiv i64 %count, GRAIN
  %low = call i64 @llvm.smax.i64(i64 %whole, i64 1)
  %threads = call i64 @llvm.smin.i64(i64 %low, i64 THREADS)
  STORES
  call void inttoptr (i64 DRIVER to ptr)(ptr %job, i64 %threads)
  %flags.at = getelementptr i64, ptr %job, i64 FLAGS
  %flags = load i64, ptr %flags.at
  %good = icmp eq i64 %flags, 0
  br i1 %good, label %finish, label %repair
repair:
  call void @spoil(ptr %table, i64 %count)
  br label %finish
finish:
  br i1 %single, label %narrow, label %end
narrow:
  call void @convert(ptr %address, ptr %result.data, i64 %total, i1 false)
  call void @free(ptr %scratch)
  br label %end
end:
  ret ptr null
}
declare i64 @llvm.smax.i64(i64, i64)
declare i64 @llvm.smin.i64(i64, i64)
"""


def handler_text(kernel: Address, driver: Address, sizes: Sequence[int],
                 limits: Sequence[float], *, minor: int, threads: int, operations: int,
                 row: int, words: int, flags: int) -> str:
    """
    Return a module with a handler; it holds addresses, so it is for this process.

    Parameters
    ----------
    kernel, driver : Address
        The lane kernel, and `run_job` of `runtime.loops`.
    sizes, limits : sequences
        Of each operand, the parameters included, and of the result: entries of a state,
        and the largest valid number.
    minor : int
        Minor version of XLA's interface.
    threads : int
        Most threads of a call.
    operations : int
        Arithmetic operations of a state, which determine the number of threads.
    row : int
        The words of a row of the table of `run_batch`.
    words, flags : int
        The words of a job of `run_job`, and the place of its flags among them.

    """
    last = len(sizes) - 1
    size_list = ', '.join(f'i64 {size}' for size in sizes)
    limit_list = ', '.join(f'double {literal(limit)}' for limit in limits)
    text = (f'@sizes = internal constant [{len(sizes)} x i64] [{size_list}]\n'
            f'@limits = internal constant [{len(limits)} x double] [{limit_list}]\n')
    text += SUPPORT + HEAD.replace('WORDS', str(words))
    text += '  %before.0 = add i64 0, 0\n'
    # Operands: the arguments of the kernel, each with its number of entries.
    for k, size in enumerate(sizes[:-2]):
        operand = OPERAND.replace('SIZE', str(size)).replace('BYTES', str(8 * size))
        text += operand.replace('NEXT', str(k + 1)).replace('K', str(k))
    text += PARAMETERS.replace('K', str(last - 1)) + SCRATCH
    label = 'place'
    # The table of addresses and strides, a row for each operand; then the job.
    for k in range(last - 1):
        text += PLACE.replace('FROM', label).replace('K', str(k))
        label = f'placed{k}'
    # The words of a job; see `runtime.loops`.
    values = [f'i64 {kernel}', 'ptr %table', f'i64 {last + 1}', 'i64 0', 'i64 0',
              'i64 0',
              'i64 0', 'i64 %count', 'i64 1']
    stores = '\n'.join(f'  %own{k} = getelementptr i64, ptr %job, i64 {k}\n'
                       f'  store {value}, ptr %own{k}' for k, value in enumerate(values))
    text += RUN.replace('STORES', stores.strip())
    grain = max(1, WORK // max(operations, 1))
    for name, number in (('GRAIN', grain), ('THREADS', threads),
                         ('FLAGS', flags), ('DRIVER', driver), ('MAJOR', MAJOR),
                         ('MINOR', minor), ('ROW', row), ('SLOTS', last + 1),
                         ('LAST', last), ('ARGUMENTS', last - 1),
                         ('BYTES', 8 * sizes[-1]), ('SIZE', max(sizes[-1], 1))):
        text = text.replace(name, str(number))
    return text.replace('HANDLER', HANDLER)
