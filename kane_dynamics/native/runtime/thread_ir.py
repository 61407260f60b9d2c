"""LLVM IR that runs shares of a batch in threads, and ends when all of them have ended."""

STACK = 2**23  # bytes of a thread's stack

# Words of a share: the arguments of `run_batch` in order, then these.
FLAGS, THREAD, FAILED = 9, 10, 11
WORDS = 12

RUN_SHARES = """
; Run each share (WORDS words) in a thread of its own, the first in this one; return when all have
; ended. A share whose thread does not start runs in this one.
define void @run_shares(ptr %shares, i64 %count) {
start:
  %attributes = alloca [32 x i64]
  %bare = call i32 @pthread_attr_init(ptr %attributes)
  %sized = call i32 @pthread_attr_setstacksize(ptr %attributes, i64 STACK)
  br label %create
create:
  %c = phi i64 [1, %start], [%c.next, %created]
  %c.more = icmp slt i64 %c, %count
  br i1 %c.more, label %created, label %first
created:
  %c.share = getelementptr [WORDS x i64], ptr %shares, i64 %c
  %c.thread = getelementptr i64, ptr %c.share, i64 THREAD
  %c.error = call i32 @pthread_create(ptr %c.thread, ptr %attributes, ptr @run_share, ptr %c.share)
  %c.failed = sext i32 %c.error to i64
  %c.failed.at = getelementptr i64, ptr %c.share, i64 FAILED
  store i64 %c.failed, ptr %c.failed.at
  %c.next = add i64 %c, 1
  br label %create
first:
  %own = call ptr @run_share(ptr %shares)
  br label %join
join:
  %j = phi i64 [1, %first], [%j.next, %joined]
  %j.more = icmp slt i64 %j, %count
  br i1 %j.more, label %end, label %done
end:
  %j.share = getelementptr [WORDS x i64], ptr %shares, i64 %j
  %j.failed.at = getelementptr i64, ptr %j.share, i64 FAILED
  %j.failed = load i64, ptr %j.failed.at
  %j.started = icmp eq i64 %j.failed, 0
  br i1 %j.started, label %wait, label %instead
wait:
  %j.thread.at = getelementptr i64, ptr %j.share, i64 THREAD
  %j.thread = load i64, ptr %j.thread.at
  %j.error = call i32 @pthread_join(i64 %j.thread, ptr null)
  br label %joined
instead:
  %j.own = call ptr @run_share(ptr %j.share)
  br label %joined
joined:
  %j.next = add i64 %j, 1
  br label %join
done:
  %cleared = call i32 @pthread_attr_destroy(ptr %attributes)
  ret void
}

define internal ptr @run_share(ptr %share) {
ARGUMENTS
  %flags = call i64 @run_batch(PASSED)
  %flags.at = getelementptr i64, ptr %share, i64 FLAGS
  store i64 %flags, ptr %flags.at
  ret ptr null
}

declare i32 @pthread_attr_init(ptr)
declare i32 @pthread_attr_setstacksize(ptr, i64)
declare i32 @pthread_attr_destroy(ptr)
declare i32 @pthread_create(ptr, ptr, ptr, ptr)
declare i32 @pthread_join(i64, ptr)
"""


def run_shares() -> str:
    """Return `RUN_SHARES`, to be added to the module of `run_batch`."""
    kinds = ['ptr', 'ptr', 'i64', 'i64', 'ptr', 'ptr', 'i64', 'i64', 'i64']
    arguments = '\n'.join(line for k, kind in enumerate(kinds) for line in (
        f'  %at{k} = getelementptr i64, ptr %share, i64 {k}',
        f'  %given{k} = load {kind}, ptr %at{k}'))
    passed = ', '.join(f'{kind} %given{k}' for k, kind in enumerate(kinds))
    text = RUN_SHARES.replace('ARGUMENTS', arguments).replace('PASSED', passed)
    for name, number in (('WORDS', WORDS), ('STACK', STACK), ('FLAGS', FLAGS), ('THREAD', THREAD),
                         ('FAILED', FAILED)):
        text = text.replace(name, str(number))
    return text
