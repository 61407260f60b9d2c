"""LLVM IR functions of an XLA handler: sizes, float32, NaN for bad states."""

# @sizes and @limits are those of the handler; SLOTS is the number of operands and the
# result.
SUPPORT = """
declare ptr @malloc(i64)
declare void @free(ptr)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
declare double @llvm.fabs.f64(double)

; Write a row of the table of `run_batch`: an address, the bytes between states, and zeros.
define internal void @put(ptr %table, i64 %k, ptr %address, i64 %stride) {
start:
  %row = getelementptr [ROW x i64], ptr %table, i64 %k
  %bytes = mul i64 ROW, 8
  call void @llvm.memset.p0.i64(ptr %row, i8 0, i64 %bytes, i1 false)
  store ptr %address, ptr %row
  %stride.at = getelementptr i64, ptr %row, i64 1
  store i64 %stride, ptr %stride.at
  ret void
}

; Return the number of entries of an XLA_FFI_Buffer.
define internal i64 @entries(ptr %buffer) {
start:
  %rank.at = getelementptr i8, ptr %buffer, i64 32
  %rank = load i64, ptr %rank.at
  %dims.at = getelementptr i8, ptr %buffer, i64 40
  %dims = load ptr, ptr %dims.at
  br label %axis
axis:
  %k = phi i64 [0, %start], [%k.next, %multiply]
  %total = phi i64 [1, %start], [%total.next, %multiply]
  %more = icmp slt i64 %k, %rank
  br i1 %more, label %multiply, label %done
multiply:
  %at = getelementptr i64, ptr %dims, i64 %k
  %size = load i64, ptr %at
  %total.next = mul i64 %total, %size
  %k.next = add i64 %k, 1
  br label %axis
done:
  ret i64 %total
}

; Convert n numbers: `wide` to double, or back.
define internal void @convert(ptr %from, ptr %to, i64 %n, i1 %wide) {
start:
  br label %next
next:
  %k = phi i64 [0, %start], [%k.next, %done]
  %more = icmp slt i64 %k, %n
  br i1 %more, label %each, label %end
each:
  br i1 %wide, label %widen, label %narrow
widen:
  %f.at = getelementptr float, ptr %from, i64 %k
  %f = load float, ptr %f.at
  %f.wide = fpext float %f to double
  %f.to = getelementptr double, ptr %to, i64 %k
  store double %f.wide, ptr %f.to
  br label %done
narrow:
  %d.at = getelementptr double, ptr %from, i64 %k
  %d = load double, ptr %d.at
  %d.narrow = fptrunc double %d to float
  %d.to = getelementptr float, ptr %to, i64 %k
  store float %d.narrow, ptr %d.to
  br label %done
done:
  %k.next = add i64 %k, 1
  br label %next
end:
  ret void
}

; Write NaN to the result of each state with a number beyond the limits.
define internal void @spoil(ptr %table, i64 %count) {
start:
  br label %state
state:
  %i = phi i64 [0, %start], [%i.next, %state.done]
  %i.more = icmp slt i64 %i, %count
  br i1 %i.more, label %slot, label %end
slot:
  %k = phi i64 [0, %state], [%k.next, %slot.done]
  %bad = phi i1 [false, %state], [%bad.in, %slot.done]
  %row.at = getelementptr [ROW x i64], ptr %table, i64 %k
  %address = load ptr, ptr %row.at
  %stride.at = getelementptr i64, ptr %row.at, i64 1
  %stride = load i64, ptr %stride.at
  %offset = mul i64 %i, %stride
  %row = getelementptr i8, ptr %address, i64 %offset
  %size.at = getelementptr i64, ptr @sizes, i64 %k
  %size = load i64, ptr %size.at
  %limit.at = getelementptr double, ptr @limits, i64 %k
  %limit = load double, ptr %limit.at
  br label %entry
entry:
  %j = phi i64 [0, %slot], [%j.next, %check]
  %bad.in = phi i1 [%bad, %slot], [%bad.out, %check]
  %j.more = icmp slt i64 %j, %size
  br i1 %j.more, label %check, label %slot.done
check:
  %x.at = getelementptr double, ptr %row, i64 %j
  %x = load double, ptr %x.at
  %x.size = call double @llvm.fabs.f64(double %x)
  %over = fcmp ugt double %x.size, %limit
  %bad.out = or i1 %bad.in, %over
  %j.next = add i64 %j, 1
  br label %entry
slot.done:
  %k.next = add i64 %k, 1
  %k.more = icmp slt i64 %k.next, SLOTS
  br i1 %k.more, label %slot, label %judge
judge:
  br i1 %bad.in, label %write, label %state.done
write:
  %bytes = mul i64 %size, 8
  call void @llvm.memset.p0.i64(ptr %row, i8 -1, i64 %bytes, i1 false)
  br label %state.done
state.done:
  %i.next = add i64 %i, 1
  br label %state
end:
  ret void
}
"""
