
%struct.block = type { ptr, ptr, i64, i64, i64, i64, i64, i64, i64, ptr, i64, i64, i64, i64, i64, i64, i64, ptr, ptr, ptr, ptr, ptr, i64, i64, i64, %struct.input, %struct.input, %struct.input, i64, i64, i64, i64, i64, ptr, ptr, i64, ptr, i64, %struct.output, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr }
%struct.input = type { ptr, ptr, ptr, i64 }
%struct.output = type { ptr, ptr, ptr, ptr }
%struct.event = type { double, double, double, double, double, double, double }
%struct.plan = type { i64, ptr, i64, i64, ptr, i64, %struct.rule, %struct.rule, %struct.rule, %struct.rule, %struct.rule, %struct.rule, %struct.rule, %struct.rule, %struct.rule, %struct.rule, %struct.rule, %struct.rule, i64, ptr, ptr, ptr }
%struct.rule = type { ptr, ptr }
%struct.layout = type { i64, ptr, ptr, i64, ptr, ptr, ptr }
%struct.slot = type { i64, i64, i64, i64, i64, i64, %struct.event }
%struct.path_head = type { double, double, double, double, double, double, double }
%struct.motion = type { i64, i64, ptr, ptr, ptr, ptr, i64 }
%struct.message = type { ptr, i64 }

; Function Attrs: nounwind
define dso_local void @cycle(ptr noundef %0, ptr nocapture noundef readonly %1, ptr nocapture noundef readonly %2, i64 noundef %3) local_unnamed_addr #0 {
  %5 = alloca [2 x i64], align 16
  %6 = alloca [2 x i64], align 16
  %7 = alloca [2 x i64], align 16
  %8 = alloca i64, align 8
  %9 = alloca [2 x i64], align 16
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %9) #6
  %10 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 49
  %11 = load ptr, ptr %10, align 8
  %12 = call i32 %11(i32 noundef 1, ptr noundef nonnull %9) #6
  %13 = load i64, ptr %9, align 16
  %14 = mul nsw i64 %13, 1000000000
  %15 = getelementptr inbounds [2 x i64], ptr %9, i64 0, i64 1
  %16 = load i64, ptr %15, align 8
  %17 = add nsw i64 %14, %16
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %9) #6
  %18 = sitofp i64 %17 to double
  %19 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 17
  %20 = load ptr, ptr %19, align 8
  %21 = getelementptr inbounds %struct.event, ptr %20, i64 0, i32 5
  store double %18, ptr %21, align 8
  %22 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 15
  store i64 %17, ptr %22, align 8
  call void @llvm.lifetime.start.p0(i64 8, ptr nonnull %8) #6
  store i64 0, ptr %8, align 8
  %23 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 28
  %24 = load atomic i64, ptr %23 acquire, align 8
  %25 = icmp eq i64 %24, 0
  br i1 %25, label %29, label %26

26:                                               ; preds = %4
  %27 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 29
  %28 = load i64, ptr %27, align 8
  store i64 %28, ptr %8, align 8
  br label %36

29:                                               ; preds = %4
  %30 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 48
  %31 = load ptr, ptr %30, align 8
  %32 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 41
  %33 = load ptr, ptr %32, align 8
  %34 = call i32 %31(ptr noundef %33, ptr noundef nonnull %8) #6
  %35 = load i64, ptr %8, align 8
  br label %36

36:                                               ; preds = %26, %29
  %37 = phi i64 [ %35, %29 ], [ %28, %26 ]
  %38 = icmp ne i64 %37, 0
  %39 = uitofp i1 %38 to double
  %40 = load ptr, ptr %19, align 8
  %41 = getelementptr inbounds %struct.event, ptr %40, i64 0, i32 4
  store double %39, ptr %41, align 8
  %42 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 14
  %43 = load i64, ptr %42, align 8
  %44 = sub nsw i64 %37, %43
  %45 = sitofp i64 %44 to double
  %46 = load ptr, ptr %19, align 8
  store double %45, ptr %46, align 8
  %47 = load i64, ptr %8, align 8
  %48 = load i64, ptr %42, align 8
  %49 = sub nsw i64 %47, %48
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %8) #6
  %50 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 2
  %51 = load i64, ptr %50, align 8
  %52 = icmp sgt i64 %51, 0
  br i1 %52, label %53, label %87

53:                                               ; preds = %36
  %54 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 1
  %55 = load ptr, ptr %54, align 8
  %56 = icmp sgt i64 %3, 0
  br label %57

57:                                               ; preds = %84, %53
  %58 = phi i64 [ 0, %53 ], [ %85, %84 ]
  %59 = getelementptr inbounds %struct.layout, ptr %55, i64 %58
  %60 = load i64, ptr %59, align 8
  %61 = icmp eq i64 %60, %3
  br i1 %61, label %62, label %84

62:                                               ; preds = %57
  br i1 %56, label %63, label %141

63:                                               ; preds = %62
  %64 = getelementptr inbounds %struct.layout, ptr %55, i64 %58, i32 1
  %65 = load ptr, ptr %64, align 8
  %66 = getelementptr inbounds %struct.layout, ptr %55, i64 %58, i32 2
  %67 = load ptr, ptr %66, align 8
  br label %68

68:                                               ; preds = %68, %63
  %69 = phi i64 [ 0, %63 ], [ %80, %68 ]
  %70 = phi i8 [ 0, %63 ], [ %79, %68 ]
  %71 = getelementptr inbounds i8, ptr %2, i64 %69
  %72 = load i8, ptr %71, align 1
  %73 = getelementptr inbounds i8, ptr %65, i64 %69
  %74 = load i8, ptr %73, align 1
  %75 = and i8 %74, %72
  %76 = getelementptr inbounds i8, ptr %67, i64 %69
  %77 = load i8, ptr %76, align 1
  %78 = xor i8 %77, %75
  %79 = or i8 %78, %70
  %80 = add nuw nsw i64 %69, 1
  %81 = icmp eq i64 %80, %3
  br i1 %81, label %82, label %68, !llvm.loop !1

82:                                               ; preds = %68
  %83 = icmp eq i8 %79, 0
  br i1 %83, label %141, label %84

84:                                               ; preds = %82, %57
  %85 = add nuw nsw i64 %58, 1
  %86 = icmp eq i64 %85, %51
  br i1 %86, label %87, label %57, !llvm.loop !4

87:                                               ; preds = %84, %36
  %88 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 6
  %89 = load atomic i64, ptr %88 monotonic, align 8
  %90 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 7
  %91 = load atomic i64, ptr %90 acquire, align 8
  %92 = sub nsw i64 %89, %91
  %93 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 10
  %94 = load i64, ptr %93, align 8
  %95 = icmp slt i64 %92, %94
  br i1 %95, label %99, label %96

96:                                               ; preds = %87
  %97 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 8
  %98 = atomicrmw add ptr %97, i64 1 seq_cst, align 8
  br label %539

99:                                               ; preds = %87
  %100 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 9
  %101 = load ptr, ptr %100, align 8
  %102 = srem i64 %89, %94
  %103 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 11
  %104 = load i64, ptr %103, align 8
  %105 = mul nsw i64 %104, %102
  %106 = getelementptr inbounds i8, ptr %101, i64 %105
  store i64 1, ptr %106, align 8
  %107 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 12
  %108 = load i64, ptr %107, align 8
  %109 = icmp slt i64 %108, %3
  %110 = select i1 %109, i64 0, i64 %3
  %111 = getelementptr inbounds %struct.slot, ptr %106, i64 0, i32 1
  store i64 %110, ptr %111, align 8
  %112 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 8
  %113 = load atomic i64, ptr %112 seq_cst, align 8
  %114 = getelementptr inbounds %struct.slot, ptr %106, i64 0, i32 2
  store i64 %113, ptr %114, align 8
  %115 = load i64, ptr %22, align 8
  %116 = getelementptr inbounds %struct.slot, ptr %106, i64 0, i32 3
  store i64 %115, ptr %116, align 8
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %7) #6
  %117 = load ptr, ptr %10, align 8
  %118 = call i32 %117(i32 noundef 1, ptr noundef nonnull %7) #6
  %119 = load i64, ptr %7, align 16
  %120 = mul nsw i64 %119, 1000000000
  %121 = getelementptr inbounds [2 x i64], ptr %7, i64 0, i64 1
  %122 = load i64, ptr %121, align 8
  %123 = add nsw i64 %120, %122
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %7) #6
  %124 = getelementptr inbounds %struct.slot, ptr %106, i64 0, i32 4
  store i64 %123, ptr %124, align 8
  %125 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 25, i32 2
  %126 = load ptr, ptr %125, align 8
  %127 = getelementptr inbounds i64, ptr %126, i64 2
  %128 = load i64, ptr %127, align 8
  %129 = getelementptr inbounds %struct.slot, ptr %106, i64 0, i32 5
  store i64 %128, ptr %129, align 8
  %130 = getelementptr inbounds %struct.slot, ptr %106, i64 0, i32 6
  %131 = load ptr, ptr %19, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr noundef nonnull align 8 dereferenceable(56) %130, ptr noundef nonnull align 8 dereferenceable(56) %131, i64 56, i1 false)
  %132 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %133 = load i64, ptr %132, align 8
  %134 = shl i64 %133, 3
  %135 = getelementptr inbounds %struct.slot, ptr %106, i64 1
  %136 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %137 = load ptr, ptr %136, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 1 %135, ptr align 8 %137, i64 %134, i1 false)
  %138 = getelementptr inbounds i8, ptr %135, i64 %134
  %139 = load i64, ptr %111, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 1 %138, ptr align 1 %2, i64 %139, i1 false)
  %140 = add nsw i64 %89, 1
  store atomic i64 %140, ptr %88 release, align 8
  br label %539

141:                                              ; preds = %82, %62
  %142 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 21
  %143 = load ptr, ptr %142, align 8
  %144 = getelementptr inbounds %struct.layout, ptr %55, i64 %58, i32 6
  %145 = load ptr, ptr %144, align 8
  %146 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 24
  %147 = load i64, ptr %146, align 8
  %148 = shl i64 %147, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %143, ptr align 8 %145, i64 %148, i1 false)
  %149 = getelementptr inbounds %struct.layout, ptr %55, i64 %58, i32 3
  %150 = load i64, ptr %149, align 8
  %151 = icmp sgt i64 %150, 0
  br i1 %151, label %152, label %170

152:                                              ; preds = %141
  %153 = getelementptr inbounds %struct.layout, ptr %55, i64 %58, i32 5
  %154 = getelementptr inbounds %struct.layout, ptr %55, i64 %58, i32 4
  br label %155

155:                                              ; preds = %155, %152
  %156 = phi i64 [ 0, %152 ], [ %167, %155 ]
  %157 = load ptr, ptr %142, align 8
  %158 = load ptr, ptr %153, align 8
  %159 = getelementptr inbounds i64, ptr %158, i64 %156
  %160 = load i64, ptr %159, align 8
  %161 = getelementptr inbounds double, ptr %157, i64 %160
  %162 = load ptr, ptr %154, align 8
  %163 = getelementptr inbounds i64, ptr %162, i64 %156
  %164 = load i64, ptr %163, align 8
  %165 = getelementptr inbounds i8, ptr %2, i64 %164
  %166 = load i64, ptr %165, align 1
  store i64 %166, ptr %161, align 8
  %167 = add nuw nsw i64 %156, 1
  %168 = load i64, ptr %149, align 8
  %169 = icmp slt i64 %167, %168
  br i1 %169, label %155, label %170, !llvm.loop !5

170:                                              ; preds = %155, %141
  %171 = getelementptr inbounds i8, ptr %2, i64 4
  %172 = load i32, ptr %171, align 1
  %173 = getelementptr inbounds i8, ptr %2, i64 8
  %174 = load i32, ptr %173, align 1
  %175 = sext i32 %172 to i64
  %176 = mul nsw i64 %175, 1000000000
  %177 = zext i32 %174 to i64
  %178 = add nsw i64 %176, %177
  %179 = icmp eq i64 %178, 0
  br i1 %179, label %183, label %180

180:                                              ; preds = %170
  %181 = load i64, ptr %42, align 8
  %182 = sub nsw i64 %178, %181
  br label %183

183:                                              ; preds = %170, %180
  %184 = phi i64 [ %182, %180 ], [ %49, %170 ]
  %185 = sitofp i64 %184 to double
  %186 = load ptr, ptr %19, align 8
  %187 = getelementptr inbounds %struct.event, ptr %186, i64 0, i32 1
  store double %185, ptr %187, align 8
  %188 = call i64 @llvm.smin.i64(i64 %49, i64 %184)
  %189 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 6
  %190 = load ptr, ptr %189, align 8
  %191 = icmp eq ptr %190, null
  br i1 %191, label %202, label %192

192:                                              ; preds = %183
  %193 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 6, i32 1
  %194 = load ptr, ptr %193, align 8
  call void %190(ptr noundef %194) #6
  %195 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %196 = load ptr, ptr %195, align 8
  %197 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %198 = load ptr, ptr %197, align 8
  %199 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %200 = load i64, ptr %199, align 8
  %201 = shl i64 %200, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %196, ptr align 8 %198, i64 %201, i1 false)
  br label %202

202:                                              ; preds = %192, %183
  %203 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %204 = load ptr, ptr %203, align 8
  %205 = load double, ptr %204, align 8
  %206 = fcmp olt double %205, 5.000000e-01
  br i1 %206, label %207, label %242

207:                                              ; preds = %202
  %208 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 10
  %209 = load ptr, ptr %208, align 8
  %210 = icmp eq ptr %209, null
  br i1 %210, label %220, label %211

211:                                              ; preds = %207
  %212 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 10, i32 1
  %213 = load ptr, ptr %212, align 8
  call void %209(ptr noundef %213) #6
  %214 = load ptr, ptr %203, align 8
  %215 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %216 = load ptr, ptr %215, align 8
  %217 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %218 = load i64, ptr %217, align 8
  %219 = shl i64 %218, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %214, ptr align 8 %216, i64 %219, i1 false)
  br label %220

220:                                              ; preds = %211, %207
  %221 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 11
  %222 = load ptr, ptr %221, align 8
  %223 = icmp eq ptr %222, null
  br i1 %223, label %242, label %224

224:                                              ; preds = %220
  %225 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 11, i32 1
  %226 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %227 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  br label %228

228:                                              ; preds = %234, %224
  %229 = phi ptr [ %222, %224 ], [ %240, %234 ]
  %230 = load ptr, ptr %203, align 8
  %231 = getelementptr inbounds %struct.path_head, ptr %230, i64 0, i32 5
  %232 = load double, ptr %231, align 8
  %233 = fcmp ogt double %232, 5.000000e-01
  br i1 %233, label %234, label %242

234:                                              ; preds = %228
  %235 = load ptr, ptr %225, align 8
  call void %229(ptr noundef %235) #6
  %236 = load ptr, ptr %203, align 8
  %237 = load ptr, ptr %226, align 8
  %238 = load i64, ptr %227, align 8
  %239 = shl i64 %238, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %236, ptr align 8 %237, i64 %239, i1 false)
  %240 = load ptr, ptr %221, align 8
  %241 = icmp eq ptr %240, null
  br i1 %241, label %242, label %228, !llvm.loop !6

242:                                              ; preds = %234, %228, %220, %202
  %243 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 15
  %244 = load ptr, ptr %243, align 8
  %245 = icmp eq ptr %244, null
  br i1 %245, label %255, label %246

246:                                              ; preds = %242
  %247 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 15, i32 1
  %248 = load ptr, ptr %247, align 8
  call void %244(ptr noundef %248) #6
  %249 = load ptr, ptr %203, align 8
  %250 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %251 = load ptr, ptr %250, align 8
  %252 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %253 = load i64, ptr %252, align 8
  %254 = shl i64 %253, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %249, ptr align 8 %251, i64 %254, i1 false)
  br label %255

255:                                              ; preds = %246, %242
  %256 = load ptr, ptr %203, align 8
  %257 = load double, ptr %256, align 8
  %258 = fcmp olt double %257, 5.000000e-01
  br i1 %258, label %259, label %427

259:                                              ; preds = %255
  %260 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 19
  %261 = load ptr, ptr %260, align 8
  %262 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 20
  %263 = load ptr, ptr %262, align 8
  %264 = icmp eq ptr %263, null
  br i1 %264, label %271, label %265

265:                                              ; preds = %259
  %266 = load i64, ptr %263, align 8
  %267 = icmp sgt i64 %266, %188
  br i1 %267, label %271, label %268

268:                                              ; preds = %265
  %269 = load ptr, ptr %19, align 8
  %270 = getelementptr inbounds %struct.event, ptr %269, i64 0, i32 2
  store double 1.000000e+00, ptr %270, align 8
  br label %279

271:                                              ; preds = %265, %259
  %272 = icmp ne ptr %261, null
  %273 = uitofp i1 %272 to double
  %274 = load ptr, ptr %19, align 8
  %275 = getelementptr inbounds %struct.event, ptr %274, i64 0, i32 2
  store double %273, ptr %275, align 8
  br i1 %272, label %279, label %276

276:                                              ; preds = %271
  %277 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 21
  %278 = load ptr, ptr %277, align 8
  br label %325

279:                                              ; preds = %271, %268
  %280 = phi ptr [ %263, %268 ], [ %261, %271 ]
  %281 = load i64, ptr %280, align 8
  %282 = sub nsw i64 %188, %281
  %283 = sitofp i64 %282 to double
  %284 = fdiv double %283, 1.000000e+09
  %285 = getelementptr inbounds %struct.motion, ptr %280, i64 0, i32 1
  %286 = load i64, ptr %285, align 8
  %287 = icmp sgt i64 %286, 0
  br i1 %287, label %288, label %303

288:                                              ; preds = %279
  %289 = getelementptr inbounds %struct.motion, ptr %280, i64 0, i32 2
  %290 = load ptr, ptr %289, align 8
  br label %291

291:                                              ; preds = %291, %288
  %292 = phi i64 [ %286, %288 ], [ %301, %291 ]
  %293 = phi i64 [ 0, %288 ], [ %300, %291 ]
  %294 = add nsw i64 %293, %292
  %295 = sdiv i64 %294, 2
  %296 = getelementptr inbounds double, ptr %290, i64 %295
  %297 = load double, ptr %296, align 8
  %298 = fcmp olt double %284, %297
  %299 = add nsw i64 %295, 1
  %300 = select i1 %298, i64 %293, i64 %299
  %301 = select i1 %298, i64 %295, i64 %292
  %302 = icmp slt i64 %300, %301
  br i1 %302, label %291, label %303, !llvm.loop !7

303:                                              ; preds = %291, %279
  %304 = phi i64 [ 0, %279 ], [ %300, %291 ]
  %305 = load ptr, ptr %19, align 8
  %306 = getelementptr inbounds %struct.event, ptr %305, i64 0, i32 6
  store double %284, ptr %306, align 8
  %307 = getelementptr inbounds %struct.motion, ptr %280, i64 0, i32 3
  %308 = load ptr, ptr %307, align 8
  %309 = getelementptr inbounds double, ptr %308, i64 %304
  %310 = load double, ptr %309, align 8
  %311 = fsub double %284, %310
  %312 = getelementptr inbounds %struct.motion, ptr %280, i64 0, i32 4
  %313 = load ptr, ptr %312, align 8
  %314 = getelementptr inbounds double, ptr %313, i64 %304
  %315 = load double, ptr %314, align 8
  %316 = fmul double %311, %315
  %317 = load ptr, ptr %19, align 8
  %318 = getelementptr inbounds %struct.event, ptr %317, i64 0, i32 3
  store double %316, ptr %318, align 8
  %319 = getelementptr inbounds %struct.motion, ptr %280, i64 0, i32 5
  %320 = load ptr, ptr %319, align 8
  %321 = getelementptr inbounds %struct.motion, ptr %280, i64 0, i32 6
  %322 = load i64, ptr %321, align 8
  %323 = mul nsw i64 %322, %304
  %324 = getelementptr inbounds double, ptr %320, i64 %323
  br label %325

325:                                              ; preds = %303, %276
  %326 = phi ptr [ %324, %303 ], [ %278, %276 ]
  %327 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 7
  %328 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 7, i32 1
  %329 = load ptr, ptr %328, align 8
  %330 = getelementptr inbounds ptr, ptr %329, i64 3
  store ptr %326, ptr %330, align 8
  %331 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 12
  %332 = load ptr, ptr %331, align 8
  %333 = icmp eq ptr %332, null
  br i1 %333, label %348, label %334

334:                                              ; preds = %325
  %335 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 12, i32 1
  %336 = load ptr, ptr %335, align 8
  %337 = getelementptr inbounds ptr, ptr %336, i64 3
  store ptr %326, ptr %337, align 8
  %338 = load ptr, ptr %331, align 8
  %339 = icmp eq ptr %338, null
  br i1 %339, label %348, label %340

340:                                              ; preds = %334
  %341 = load ptr, ptr %335, align 8
  call void %338(ptr noundef %341) #6
  %342 = load ptr, ptr %203, align 8
  %343 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %344 = load ptr, ptr %343, align 8
  %345 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %346 = load i64, ptr %345, align 8
  %347 = shl i64 %346, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %342, ptr align 8 %344, i64 %347, i1 false)
  br label %348

348:                                              ; preds = %340, %334, %325
  %349 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 13
  %350 = load ptr, ptr %349, align 8
  %351 = icmp eq ptr %350, null
  br i1 %351, label %370, label %352

352:                                              ; preds = %348
  %353 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 13, i32 1
  %354 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %355 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  br label %356

356:                                              ; preds = %362, %352
  %357 = phi ptr [ %350, %352 ], [ %368, %362 ]
  %358 = load ptr, ptr %203, align 8
  %359 = getelementptr inbounds %struct.path_head, ptr %358, i64 0, i32 5
  %360 = load double, ptr %359, align 8
  %361 = fcmp ogt double %360, 5.000000e-01
  br i1 %361, label %362, label %370

362:                                              ; preds = %356
  %363 = load ptr, ptr %353, align 8
  call void %357(ptr noundef %363) #6
  %364 = load ptr, ptr %203, align 8
  %365 = load ptr, ptr %354, align 8
  %366 = load i64, ptr %355, align 8
  %367 = shl i64 %366, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %364, ptr align 8 %365, i64 %367, i1 false)
  %368 = load ptr, ptr %349, align 8
  %369 = icmp eq ptr %368, null
  br i1 %369, label %370, label %356, !llvm.loop !6

370:                                              ; preds = %362, %356, %348
  %371 = load ptr, ptr %203, align 8
  %372 = load double, ptr %371, align 8
  %373 = fcmp olt double %372, 5.000000e-01
  br i1 %373, label %374, label %427

374:                                              ; preds = %370
  %375 = load ptr, ptr %327, align 8
  %376 = load ptr, ptr %328, align 8
  call void %375(ptr noundef %376) #6
  %377 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 16
  %378 = load ptr, ptr %377, align 8
  %379 = icmp eq ptr %378, null
  br i1 %379, label %415, label %380

380:                                              ; preds = %374
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %6) #6
  %381 = load ptr, ptr %10, align 8
  %382 = call i32 %381(i32 noundef 1, ptr noundef nonnull %6) #6
  %383 = load i64, ptr %6, align 16
  %384 = mul nsw i64 %383, 1000000000
  %385 = getelementptr inbounds [2 x i64], ptr %6, i64 0, i64 1
  %386 = load i64, ptr %385, align 8
  %387 = add nsw i64 %384, %386
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %6) #6
  %388 = sitofp i64 %387 to double
  %389 = load ptr, ptr %19, align 8
  %390 = getelementptr inbounds %struct.event, ptr %389, i64 0, i32 5
  store double %388, ptr %390, align 8
  %391 = load i64, ptr %22, align 8
  %392 = sub nsw i64 %387, %391
  %393 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 18
  %394 = load i64, ptr %393, align 8
  %395 = icmp sgt i64 %392, %394
  br i1 %395, label %396, label %415

396:                                              ; preds = %380
  %397 = load ptr, ptr %377, align 8
  %398 = icmp eq ptr %397, null
  br i1 %398, label %408, label %399

399:                                              ; preds = %396
  %400 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 16, i32 1
  %401 = load ptr, ptr %400, align 8
  call void %397(ptr noundef %401) #6
  %402 = load ptr, ptr %203, align 8
  %403 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %404 = load ptr, ptr %403, align 8
  %405 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %406 = load i64, ptr %405, align 8
  %407 = shl i64 %406, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %402, ptr align 8 %404, i64 %407, i1 false)
  br label %408

408:                                              ; preds = %399, %396
  %409 = load ptr, ptr %203, align 8
  %410 = load double, ptr %409, align 8
  %411 = fcmp olt double %410, 5.000000e-01
  br i1 %411, label %412, label %427

412:                                              ; preds = %408
  %413 = load ptr, ptr %327, align 8
  %414 = load ptr, ptr %328, align 8
  call void %413(ptr noundef %414) #6
  br label %415

415:                                              ; preds = %374, %380, %412
  %416 = load ptr, ptr %203, align 8
  %417 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %418 = load ptr, ptr %417, align 8
  %419 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %420 = load i64, ptr %419, align 8
  %421 = shl i64 %420, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %416, ptr align 8 %418, i64 %421, i1 false)
  %422 = load ptr, ptr %203, align 8
  %423 = load double, ptr %422, align 8
  %424 = fcmp olt double %423, 5.000000e-01
  br i1 %424, label %425, label %427

425:                                              ; preds = %415
  %426 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 35
  store i64 0, ptr %426, align 8
  br label %486

427:                                              ; preds = %408, %370, %255, %415
  %428 = phi double [ %410, %408 ], [ %372, %370 ], [ %257, %255 ], [ %423, %415 ]
  %429 = fcmp oeq double %428, 2.000000e+00
  br i1 %429, label %430, label %438

430:                                              ; preds = %427
  %431 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 12
  %432 = load i64, ptr %431, align 8
  %433 = icmp slt i64 %432, %3
  br i1 %433, label %438, label %434

434:                                              ; preds = %430
  %435 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 34
  %436 = load ptr, ptr %435, align 8
  call void @llvm.memmove.p0.p0.i64(ptr align 1 %436, ptr align 1 %2, i64 %3, i1 false)
  %437 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 35
  store i64 %3, ptr %437, align 8
  br label %438

438:                                              ; preds = %434, %430, %427
  %439 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 8
  %440 = load ptr, ptr %439, align 8
  %441 = icmp eq ptr %440, null
  br i1 %441, label %451, label %442

442:                                              ; preds = %438
  %443 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 8, i32 1
  %444 = load ptr, ptr %443, align 8
  call void %440(ptr noundef %444) #6
  %445 = load ptr, ptr %203, align 8
  %446 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %447 = load ptr, ptr %446, align 8
  %448 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %449 = load i64, ptr %448, align 8
  %450 = shl i64 %449, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %445, ptr align 8 %447, i64 %450, i1 false)
  br label %451

451:                                              ; preds = %442, %438
  %452 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 13
  %453 = load ptr, ptr %452, align 8
  %454 = icmp eq ptr %453, null
  br i1 %454, label %473, label %455

455:                                              ; preds = %451
  %456 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 13, i32 1
  %457 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %458 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  br label %459

459:                                              ; preds = %465, %455
  %460 = phi ptr [ %453, %455 ], [ %471, %465 ]
  %461 = load ptr, ptr %203, align 8
  %462 = getelementptr inbounds %struct.path_head, ptr %461, i64 0, i32 5
  %463 = load double, ptr %462, align 8
  %464 = fcmp ogt double %463, 5.000000e-01
  br i1 %464, label %465, label %473

465:                                              ; preds = %459
  %466 = load ptr, ptr %456, align 8
  call void %460(ptr noundef %466) #6
  %467 = load ptr, ptr %203, align 8
  %468 = load ptr, ptr %457, align 8
  %469 = load i64, ptr %458, align 8
  %470 = shl i64 %469, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %467, ptr align 8 %468, i64 %470, i1 false)
  %471 = load ptr, ptr %452, align 8
  %472 = icmp eq ptr %471, null
  br i1 %472, label %473, label %459, !llvm.loop !6

473:                                              ; preds = %465, %459, %451
  %474 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 14
  %475 = load ptr, ptr %474, align 8
  %476 = icmp eq ptr %475, null
  br i1 %476, label %486, label %477

477:                                              ; preds = %473
  %478 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 14, i32 1
  %479 = load ptr, ptr %478, align 8
  call void %475(ptr noundef %479) #6
  %480 = load ptr, ptr %203, align 8
  %481 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %482 = load ptr, ptr %481, align 8
  %483 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %484 = load i64, ptr %483, align 8
  %485 = shl i64 %484, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %480, ptr align 8 %482, i64 %485, i1 false)
  br label %486

486:                                              ; preds = %477, %473, %425
  call fastcc void @publish_result(ptr noundef nonnull %0)
  %487 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 6
  %488 = load atomic i64, ptr %487 monotonic, align 8
  %489 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 7
  %490 = load atomic i64, ptr %489 acquire, align 8
  %491 = sub nsw i64 %488, %490
  %492 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 10
  %493 = load i64, ptr %492, align 8
  %494 = icmp slt i64 %491, %493
  br i1 %494, label %498, label %495

495:                                              ; preds = %486
  %496 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 8
  %497 = atomicrmw add ptr %496, i64 1 seq_cst, align 8
  br label %539

498:                                              ; preds = %486
  %499 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 9
  %500 = load ptr, ptr %499, align 8
  %501 = srem i64 %488, %493
  %502 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 11
  %503 = load i64, ptr %502, align 8
  %504 = mul nsw i64 %503, %501
  %505 = getelementptr inbounds i8, ptr %500, i64 %504
  store i64 0, ptr %505, align 8
  %506 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 12
  %507 = load i64, ptr %506, align 8
  %508 = icmp slt i64 %507, %3
  %509 = select i1 %508, i64 0, i64 %3
  %510 = getelementptr inbounds %struct.slot, ptr %505, i64 0, i32 1
  store i64 %509, ptr %510, align 8
  %511 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 8
  %512 = load atomic i64, ptr %511 seq_cst, align 8
  %513 = getelementptr inbounds %struct.slot, ptr %505, i64 0, i32 2
  store i64 %512, ptr %513, align 8
  %514 = load i64, ptr %22, align 8
  %515 = getelementptr inbounds %struct.slot, ptr %505, i64 0, i32 3
  store i64 %514, ptr %515, align 8
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %5) #6
  %516 = load ptr, ptr %10, align 8
  %517 = call i32 %516(i32 noundef 1, ptr noundef nonnull %5) #6
  %518 = load i64, ptr %5, align 16
  %519 = mul nsw i64 %518, 1000000000
  %520 = getelementptr inbounds [2 x i64], ptr %5, i64 0, i64 1
  %521 = load i64, ptr %520, align 8
  %522 = add nsw i64 %519, %521
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %5) #6
  %523 = getelementptr inbounds %struct.slot, ptr %505, i64 0, i32 4
  store i64 %522, ptr %523, align 8
  %524 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 25, i32 2
  %525 = load ptr, ptr %524, align 8
  %526 = getelementptr inbounds i64, ptr %525, i64 2
  %527 = load i64, ptr %526, align 8
  %528 = getelementptr inbounds %struct.slot, ptr %505, i64 0, i32 5
  store i64 %527, ptr %528, align 8
  %529 = getelementptr inbounds %struct.slot, ptr %505, i64 0, i32 6
  %530 = load ptr, ptr %19, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr noundef nonnull align 8 dereferenceable(56) %529, ptr noundef nonnull align 8 dereferenceable(56) %530, i64 56, i1 false)
  %531 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %532 = load i64, ptr %531, align 8
  %533 = shl i64 %532, 3
  %534 = getelementptr inbounds %struct.slot, ptr %505, i64 1
  %535 = load ptr, ptr %203, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 1 %534, ptr align 8 %535, i64 %533, i1 false)
  %536 = getelementptr inbounds i8, ptr %534, i64 %533
  %537 = load i64, ptr %510, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 1 %536, ptr align 1 %2, i64 %537, i1 false)
  %538 = add nsw i64 %488, 1
  store atomic i64 %538, ptr %487 release, align 8
  br label %539

539:                                              ; preds = %498, %495, %99, %96
  ret void
}

; Function Attrs: argmemonly mustprogress nocallback nofree nosync nounwind willreturn
declare void @llvm.lifetime.start.p0(i64 immarg, ptr nocapture) #1

; Function Attrs: nounwind
define internal fastcc void @publish_result(ptr nocapture noundef %0) unnamed_addr #0 {
  %2 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 37
  %3 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %4 = load ptr, ptr %3, align 8
  %5 = getelementptr inbounds %struct.path_head, ptr %4, i64 0, i32 1
  %6 = load double, ptr %5, align 8
  %7 = fcmp ogt double %6, 5.000000e-01
  br i1 %7, label %8, label %21

8:                                                ; preds = %1
  %9 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 36
  %10 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 20
  %11 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 23
  %12 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 14
  %13 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 47
  %14 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 4
  %15 = load i64, ptr %2, align 8
  %16 = icmp sgt i64 %15, 0
  br i1 %16, label %26, label %21

17:                                               ; preds = %61
  %18 = add nuw nsw i64 %27, 1
  %19 = load i64, ptr %2, align 8
  %20 = icmp slt i64 %18, %19
  br i1 %20, label %26, label %21, !llvm.loop !8

21:                                               ; preds = %61, %17, %8, %1
  %22 = phi ptr [ %4, %1 ], [ %4, %8 ], [ %62, %17 ], [ %62, %61 ]
  %23 = getelementptr inbounds %struct.path_head, ptr %22, i64 0, i32 3
  %24 = load double, ptr %23, align 8
  %25 = fcmp ogt double %24, -5.000000e-01
  br i1 %25, label %66, label %82

26:                                               ; preds = %8, %17
  %27 = phi i64 [ %18, %17 ], [ 0, %8 ]
  %28 = load ptr, ptr %9, align 8
  %29 = getelementptr inbounds %struct.output, ptr %28, i64 %27
  %30 = getelementptr inbounds %struct.output, ptr %28, i64 %27, i32 2
  %31 = load ptr, ptr %30, align 8
  %32 = load ptr, ptr %10, align 8
  %33 = load i64, ptr %11, align 8
  %34 = shl i64 %33, 3
  tail call void @llvm.memcpy.p0.p0.i64(ptr align 8 %31, ptr align 8 %32, i64 %34, i1 false)
  %35 = getelementptr inbounds %struct.output, ptr %28, i64 %27, i32 3
  %36 = load ptr, ptr %35, align 8
  %37 = icmp eq ptr %36, null
  br i1 %37, label %50, label %38

38:                                               ; preds = %26
  %39 = load ptr, ptr %3, align 8
  %40 = getelementptr inbounds %struct.path_head, ptr %39, i64 0, i32 2
  %41 = load double, ptr %40, align 8
  %42 = fptosi double %41 to i64
  %43 = load i64, ptr %12, align 8
  %44 = add nsw i64 %43, %42
  %45 = sdiv i64 %44, 1000000000
  %46 = trunc i64 %45 to i32
  %47 = srem i64 %44, 1000000000
  %48 = trunc i64 %47 to i32
  store i32 %46, ptr %36, align 1
  %49 = getelementptr inbounds i8, ptr %36, i64 4
  store i32 %48, ptr %49, align 1
  br label %50

50:                                               ; preds = %38, %26
  %51 = load ptr, ptr %29, align 8
  %52 = icmp eq ptr %51, null
  br i1 %52, label %61, label %53

53:                                               ; preds = %50
  %54 = load ptr, ptr %13, align 8
  %55 = getelementptr inbounds %struct.output, ptr %28, i64 %27, i32 1
  %56 = load ptr, ptr %55, align 8
  %57 = tail call i32 %54(ptr noundef nonnull %51, ptr noundef %56, ptr noundef null) #6
  %58 = icmp eq i32 %57, 0
  br i1 %58, label %61, label %59

59:                                               ; preds = %53
  %60 = sext i32 %57 to i64
  store atomic i64 %60, ptr %14 seq_cst, align 8
  br label %61

61:                                               ; preds = %50, %53, %59
  %62 = load ptr, ptr %3, align 8
  %63 = getelementptr inbounds %struct.path_head, ptr %62, i64 0, i32 1
  %64 = load double, ptr %63, align 8
  %65 = fcmp ogt double %64, 5.000000e-01
  br i1 %65, label %17, label %21, !llvm.loop !8

66:                                               ; preds = %21
  %67 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 38
  %68 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 38, i32 2
  %69 = load ptr, ptr %68, align 8
  store double %24, ptr %69, align 8
  %70 = load ptr, ptr %67, align 8
  %71 = icmp eq ptr %70, null
  br i1 %71, label %82, label %72

72:                                               ; preds = %66
  %73 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 47
  %74 = load ptr, ptr %73, align 8
  %75 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 38, i32 1
  %76 = load ptr, ptr %75, align 8
  %77 = tail call i32 %74(ptr noundef nonnull %70, ptr noundef %76, ptr noundef null) #6
  %78 = icmp eq i32 %77, 0
  br i1 %78, label %82, label %79

79:                                               ; preds = %72
  %80 = sext i32 %77 to i64
  %81 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 4
  store atomic i64 %80, ptr %81 seq_cst, align 8
  br label %82

82:                                               ; preds = %79, %72, %66, %21
  ret void
}

; Function Attrs: argmemonly mustprogress nocallback nofree nosync nounwind willreturn
declare void @llvm.lifetime.end.p0(i64 immarg, ptr nocapture) #1

; Function Attrs: nounwind
define dso_local void @look_at_time(ptr nocapture noundef %0, ptr nocapture noundef readonly %1) local_unnamed_addr #0 {
  %3 = alloca [2 x i64], align 16
  %4 = alloca i64, align 8
  %5 = alloca [2 x i64], align 16
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %5) #6
  %6 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 49
  %7 = load ptr, ptr %6, align 8
  %8 = call i32 %7(i32 noundef 1, ptr noundef nonnull %5) #6
  %9 = load i64, ptr %5, align 16
  %10 = mul nsw i64 %9, 1000000000
  %11 = getelementptr inbounds [2 x i64], ptr %5, i64 0, i64 1
  %12 = load i64, ptr %11, align 8
  %13 = add nsw i64 %10, %12
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %5) #6
  %14 = sitofp i64 %13 to double
  %15 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 17
  %16 = load ptr, ptr %15, align 8
  %17 = getelementptr inbounds %struct.event, ptr %16, i64 0, i32 5
  store double %14, ptr %17, align 8
  call void @llvm.lifetime.start.p0(i64 8, ptr nonnull %4) #6
  store i64 0, ptr %4, align 8
  %18 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 28
  %19 = load atomic i64, ptr %18 acquire, align 8
  %20 = icmp eq i64 %19, 0
  br i1 %20, label %23, label %21

21:                                               ; preds = %2
  %22 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 29
  br label %29

23:                                               ; preds = %2
  %24 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 48
  %25 = load ptr, ptr %24, align 8
  %26 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 41
  %27 = load ptr, ptr %26, align 8
  %28 = call i32 %25(ptr noundef %27, ptr noundef nonnull %4) #6
  br label %29

29:                                               ; preds = %21, %23
  %30 = phi ptr [ %4, %23 ], [ %22, %21 ]
  %31 = load i64, ptr %30, align 8
  %32 = icmp ne i64 %31, 0
  %33 = uitofp i1 %32 to double
  %34 = load ptr, ptr %15, align 8
  %35 = getelementptr inbounds %struct.event, ptr %34, i64 0, i32 4
  store double %33, ptr %35, align 8
  %36 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 14
  %37 = load i64, ptr %36, align 8
  %38 = sub nsw i64 %31, %37
  %39 = sitofp i64 %38 to double
  %40 = load ptr, ptr %15, align 8
  store double %39, ptr %40, align 8
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %4) #6
  %41 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %42 = load ptr, ptr %41, align 8
  %43 = getelementptr inbounds %struct.path_head, ptr %42, i64 0, i32 6
  %44 = load double, ptr %43, align 8
  %45 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 9
  %46 = load ptr, ptr %45, align 8
  %47 = icmp eq ptr %46, null
  br i1 %47, label %57, label %48

48:                                               ; preds = %29
  %49 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 9, i32 1
  %50 = load ptr, ptr %49, align 8
  call void %46(ptr noundef %50) #6
  %51 = load ptr, ptr %41, align 8
  %52 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %53 = load ptr, ptr %52, align 8
  %54 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %55 = load i64, ptr %54, align 8
  %56 = shl i64 %55, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %51, ptr align 8 %53, i64 %56, i1 false)
  br label %57

57:                                               ; preds = %29, %48
  call fastcc void @publish_result(ptr noundef nonnull %0)
  %58 = load ptr, ptr %41, align 8
  %59 = getelementptr inbounds %struct.path_head, ptr %58, i64 0, i32 6
  %60 = load double, ptr %59, align 8
  %61 = fcmp une double %60, %44
  br i1 %61, label %62, label %114

62:                                               ; preds = %57
  %63 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 34
  %64 = load ptr, ptr %63, align 8
  %65 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 6
  %66 = load atomic i64, ptr %65 monotonic, align 8
  %67 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 7
  %68 = load atomic i64, ptr %67 acquire, align 8
  %69 = sub nsw i64 %66, %68
  %70 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 10
  %71 = load i64, ptr %70, align 8
  %72 = icmp slt i64 %69, %71
  br i1 %72, label %76, label %73

73:                                               ; preds = %62
  %74 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 8
  %75 = atomicrmw add ptr %74, i64 1 seq_cst, align 8
  br label %114

76:                                               ; preds = %62
  %77 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 9
  %78 = load ptr, ptr %77, align 8
  %79 = srem i64 %66, %71
  %80 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 11
  %81 = load i64, ptr %80, align 8
  %82 = mul nsw i64 %81, %79
  %83 = getelementptr inbounds i8, ptr %78, i64 %82
  store i64 2, ptr %83, align 8
  %84 = getelementptr inbounds %struct.slot, ptr %83, i64 0, i32 1
  store i64 0, ptr %84, align 8
  %85 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 8
  %86 = load atomic i64, ptr %85 seq_cst, align 8
  %87 = getelementptr inbounds %struct.slot, ptr %83, i64 0, i32 2
  store i64 %86, ptr %87, align 8
  %88 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 15
  %89 = load i64, ptr %88, align 8
  %90 = getelementptr inbounds %struct.slot, ptr %83, i64 0, i32 3
  store i64 %89, ptr %90, align 8
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %3) #6
  %91 = load ptr, ptr %6, align 8
  %92 = call i32 %91(i32 noundef 1, ptr noundef nonnull %3) #6
  %93 = load i64, ptr %3, align 16
  %94 = mul nsw i64 %93, 1000000000
  %95 = getelementptr inbounds [2 x i64], ptr %3, i64 0, i64 1
  %96 = load i64, ptr %95, align 8
  %97 = add nsw i64 %94, %96
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %3) #6
  %98 = getelementptr inbounds %struct.slot, ptr %83, i64 0, i32 4
  store i64 %97, ptr %98, align 8
  %99 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 25, i32 2
  %100 = load ptr, ptr %99, align 8
  %101 = getelementptr inbounds i64, ptr %100, i64 2
  %102 = load i64, ptr %101, align 8
  %103 = getelementptr inbounds %struct.slot, ptr %83, i64 0, i32 5
  store i64 %102, ptr %103, align 8
  %104 = getelementptr inbounds %struct.slot, ptr %83, i64 0, i32 6
  %105 = load ptr, ptr %15, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr noundef nonnull align 8 dereferenceable(56) %104, ptr noundef nonnull align 8 dereferenceable(56) %105, i64 56, i1 false)
  %106 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %107 = load i64, ptr %106, align 8
  %108 = shl i64 %107, 3
  %109 = getelementptr inbounds %struct.slot, ptr %83, i64 1
  %110 = load ptr, ptr %41, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 1 %109, ptr align 8 %110, i64 %108, i1 false)
  %111 = getelementptr inbounds i8, ptr %109, i64 %108
  %112 = load i64, ptr %84, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 1 %111, ptr align 1 %64, i64 %112, i1 false)
  %113 = add nsw i64 %66, 1
  store atomic i64 %113, ptr %65 release, align 8
  br label %114

114:                                              ; preds = %76, %73, %57
  ret void
}

; Function Attrs: nounwind
define dso_local void @hear(ptr noundef %0, ptr nocapture noundef readonly %1, ptr nocapture noundef readonly %2, i64 noundef %3) local_unnamed_addr #0 {
  %5 = alloca [2 x i64], align 16
  %6 = alloca i64, align 8
  %7 = alloca [2 x i64], align 16
  %8 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 30
  %9 = load i64, ptr %8, align 8
  %10 = icmp eq i64 %9, %3
  br i1 %10, label %11, label %133

11:                                               ; preds = %4
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %7) #6
  %12 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 49
  %13 = load ptr, ptr %12, align 8
  %14 = call i32 %13(i32 noundef 1, ptr noundef nonnull %7) #6
  %15 = load i64, ptr %7, align 16
  %16 = mul nsw i64 %15, 1000000000
  %17 = getelementptr inbounds [2 x i64], ptr %7, i64 0, i64 1
  %18 = load i64, ptr %17, align 8
  %19 = add nsw i64 %16, %18
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %7) #6
  %20 = sitofp i64 %19 to double
  %21 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 17
  %22 = load ptr, ptr %21, align 8
  %23 = getelementptr inbounds %struct.event, ptr %22, i64 0, i32 5
  store double %20, ptr %23, align 8
  %24 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 15
  store i64 %19, ptr %24, align 8
  call void @llvm.lifetime.start.p0(i64 8, ptr nonnull %6) #6
  store i64 0, ptr %6, align 8
  %25 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 28
  %26 = load atomic i64, ptr %25 acquire, align 8
  %27 = icmp eq i64 %26, 0
  br i1 %27, label %30, label %28

28:                                               ; preds = %11
  %29 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 29
  br label %36

30:                                               ; preds = %11
  %31 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 48
  %32 = load ptr, ptr %31, align 8
  %33 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 41
  %34 = load ptr, ptr %33, align 8
  %35 = call i32 %32(ptr noundef %34, ptr noundef nonnull %6) #6
  br label %36

36:                                               ; preds = %28, %30
  %37 = phi ptr [ %6, %30 ], [ %29, %28 ]
  %38 = load i64, ptr %37, align 8
  %39 = icmp ne i64 %38, 0
  %40 = uitofp i1 %39 to double
  %41 = load ptr, ptr %21, align 8
  %42 = getelementptr inbounds %struct.event, ptr %41, i64 0, i32 4
  store double %40, ptr %42, align 8
  %43 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 14
  %44 = load i64, ptr %43, align 8
  %45 = sub nsw i64 %38, %44
  %46 = sitofp i64 %45 to double
  %47 = load ptr, ptr %21, align 8
  store double %46, ptr %47, align 8
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %6) #6
  %48 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 33
  %49 = load ptr, ptr %48, align 8
  %50 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 31
  %51 = load i64, ptr %50, align 8
  %52 = getelementptr inbounds i8, ptr %2, i64 %51
  %53 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 32
  %54 = load i64, ptr %53, align 8
  %55 = shl i64 %54, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %49, ptr align 1 %52, i64 %55, i1 false)
  %56 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 17
  %57 = load ptr, ptr %56, align 8
  %58 = icmp eq ptr %57, null
  br i1 %58, label %69, label %59

59:                                               ; preds = %36
  %60 = getelementptr inbounds %struct.plan, ptr %1, i64 0, i32 17, i32 1
  %61 = load ptr, ptr %60, align 8
  call void %57(ptr noundef %61) #6
  %62 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %63 = load ptr, ptr %62, align 8
  %64 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 19
  %65 = load ptr, ptr %64, align 8
  %66 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %67 = load i64, ptr %66, align 8
  %68 = shl i64 %67, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %63, ptr align 8 %65, i64 %68, i1 false)
  br label %69

69:                                               ; preds = %36, %59
  call fastcc void @publish_result(ptr noundef nonnull %0)
  %70 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 34
  %71 = load ptr, ptr %70, align 8
  %72 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 6
  %73 = load atomic i64, ptr %72 monotonic, align 8
  %74 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 7
  %75 = load atomic i64, ptr %74 acquire, align 8
  %76 = sub nsw i64 %73, %75
  %77 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 10
  %78 = load i64, ptr %77, align 8
  %79 = icmp slt i64 %76, %78
  br i1 %79, label %83, label %80

80:                                               ; preds = %69
  %81 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 8
  %82 = atomicrmw add ptr %81, i64 1 seq_cst, align 8
  br label %121

83:                                               ; preds = %69
  %84 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 9
  %85 = load ptr, ptr %84, align 8
  %86 = srem i64 %73, %78
  %87 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 11
  %88 = load i64, ptr %87, align 8
  %89 = mul nsw i64 %88, %86
  %90 = getelementptr inbounds i8, ptr %85, i64 %89
  store i64 3, ptr %90, align 8
  %91 = getelementptr inbounds %struct.slot, ptr %90, i64 0, i32 1
  store i64 0, ptr %91, align 8
  %92 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 8
  %93 = load atomic i64, ptr %92 seq_cst, align 8
  %94 = getelementptr inbounds %struct.slot, ptr %90, i64 0, i32 2
  store i64 %93, ptr %94, align 8
  %95 = load i64, ptr %24, align 8
  %96 = getelementptr inbounds %struct.slot, ptr %90, i64 0, i32 3
  store i64 %95, ptr %96, align 8
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %5) #6
  %97 = load ptr, ptr %12, align 8
  %98 = call i32 %97(i32 noundef 1, ptr noundef nonnull %5) #6
  %99 = load i64, ptr %5, align 16
  %100 = mul nsw i64 %99, 1000000000
  %101 = getelementptr inbounds [2 x i64], ptr %5, i64 0, i64 1
  %102 = load i64, ptr %101, align 8
  %103 = add nsw i64 %100, %102
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %5) #6
  %104 = getelementptr inbounds %struct.slot, ptr %90, i64 0, i32 4
  store i64 %103, ptr %104, align 8
  %105 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 25, i32 2
  %106 = load ptr, ptr %105, align 8
  %107 = getelementptr inbounds i64, ptr %106, i64 2
  %108 = load i64, ptr %107, align 8
  %109 = getelementptr inbounds %struct.slot, ptr %90, i64 0, i32 5
  store i64 %108, ptr %109, align 8
  %110 = getelementptr inbounds %struct.slot, ptr %90, i64 0, i32 6
  %111 = load ptr, ptr %21, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr noundef nonnull align 8 dereferenceable(56) %110, ptr noundef nonnull align 8 dereferenceable(56) %111, i64 56, i1 false)
  %112 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 22
  %113 = load i64, ptr %112, align 8
  %114 = shl i64 %113, 3
  %115 = getelementptr inbounds %struct.slot, ptr %90, i64 1
  %116 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %117 = load ptr, ptr %116, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 1 %115, ptr align 8 %117, i64 %114, i1 false)
  %118 = getelementptr inbounds i8, ptr %115, i64 %114
  %119 = load i64, ptr %91, align 8
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 1 %118, ptr align 1 %71, i64 %119, i1 false)
  %120 = add nsw i64 %73, 1
  store atomic i64 %120, ptr %72 release, align 8
  br label %121

121:                                              ; preds = %80, %83
  %122 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %123 = load ptr, ptr %122, align 8
  %124 = getelementptr inbounds %struct.path_head, ptr %123, i64 0, i32 4
  %125 = load double, ptr %124, align 8
  %126 = fcmp ogt double %125, 5.000000e-01
  br i1 %126, label %127, label %133

127:                                              ; preds = %121
  %128 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 35
  %129 = load i64, ptr %128, align 8
  %130 = icmp eq i64 %129, 0
  br i1 %130, label %133, label %131

131:                                              ; preds = %127
  store i64 0, ptr %128, align 8
  %132 = load ptr, ptr %70, align 8
  call void @cycle(ptr noundef nonnull %0, ptr noundef nonnull %1, ptr noundef %132, i64 noundef %129)
  br label %133

133:                                              ; preds = %4, %131, %127, %121
  ret void
}

; Function Attrs: argmemonly mustprogress nocallback nofree nounwind willreturn
declare void @llvm.memcpy.p0.p0.i64(ptr noalias nocapture writeonly, ptr noalias nocapture readonly, i64, i1 immarg) #2

; Function Attrs: nounwind
define dso_local ptr @run(ptr noundef %0) local_unnamed_addr #0 {
  %2 = alloca [3 x ptr], align 16
  %3 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 1
  %4 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 2
  %5 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 16
  %6 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 25
  %7 = getelementptr inbounds ptr, ptr %2, i64 1
  %8 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 26
  %9 = getelementptr inbounds ptr, ptr %2, i64 2
  %10 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 27
  %11 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 42
  %12 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 39
  %13 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 43
  %14 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 44
  %15 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 40
  %16 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 45
  %17 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 46
  %18 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 26, i32 1
  %19 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 26, i32 2
  %20 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 26, i32 3
  %21 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 29
  %22 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 5
  %23 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 50
  %24 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 13
  %25 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 25, i32 1
  %26 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 25, i32 2
  %27 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 25, i32 3
  %28 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 28
  %29 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 27, i32 1
  %30 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 27, i32 2
  %31 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 27, i32 3
  %32 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 4
  br label %33

33:                                               ; preds = %1, %241
  %34 = phi i8 [ 0, %1 ], [ %243, %241 ]
  %35 = load atomic i64, ptr %0 acquire, align 8
  %36 = inttoptr i64 %35 to ptr
  store atomic i64 %35, ptr %3 release, align 8
  %37 = load atomic i64, ptr %4 acquire, align 8
  %38 = icmp eq i64 %37, 0
  br i1 %38, label %39, label %262

39:                                               ; preds = %33
  %40 = getelementptr inbounds %struct.plan, ptr %36, i64 0, i32 3
  %41 = load i64, ptr %40, align 8
  %42 = load i64, ptr %5, align 8
  %43 = icmp eq i64 %41, %42
  br i1 %43, label %49, label %44

44:                                               ; preds = %39
  store i64 %41, ptr %5, align 8
  %45 = getelementptr inbounds %struct.plan, ptr %36, i64 0, i32 4
  %46 = load ptr, ptr %45, align 8
  %47 = getelementptr inbounds %struct.plan, ptr %36, i64 0, i32 5
  %48 = load i64, ptr %47, align 8
  tail call void @cycle(ptr noundef nonnull %0, ptr noundef nonnull %36, ptr noundef %46, i64 noundef %48)
  br label %49

49:                                               ; preds = %44, %39
  %50 = load i64, ptr %36, align 8
  call void @llvm.lifetime.start.p0(i64 24, ptr nonnull %2) #6
  store ptr %6, ptr %2, align 16
  store ptr %8, ptr %7, align 8
  store ptr %10, ptr %9, align 16
  %51 = load ptr, ptr %11, align 8
  %52 = load ptr, ptr %12, align 8
  %53 = tail call i32 %51(ptr noundef %52) #6
  br label %54

54:                                               ; preds = %66, %49
  %55 = phi i64 [ 0, %49 ], [ %68, %66 ]
  %56 = phi i32 [ %53, %49 ], [ %67, %66 ]
  %57 = getelementptr inbounds [3 x ptr], ptr %2, i64 0, i64 %55
  %58 = load ptr, ptr %57, align 8
  %59 = load ptr, ptr %58, align 8
  %60 = icmp eq ptr %59, null
  br i1 %60, label %66, label %61

61:                                               ; preds = %54
  %62 = load ptr, ptr %13, align 8
  %63 = load ptr, ptr %12, align 8
  %64 = tail call i32 %62(ptr noundef %63, ptr noundef nonnull %59, ptr noundef null) #6
  %65 = or i32 %64, %56
  br label %66

66:                                               ; preds = %61, %54
  %67 = phi i32 [ %65, %61 ], [ %56, %54 ]
  %68 = add nuw nsw i64 %55, 1
  %69 = icmp eq i64 %68, 3
  br i1 %69, label %70, label %54, !llvm.loop !9

70:                                               ; preds = %66
  %71 = load ptr, ptr %14, align 8
  %72 = load ptr, ptr %12, align 8
  %73 = load ptr, ptr %15, align 8
  %74 = tail call i32 %71(ptr noundef %72, ptr noundef %73, ptr noundef null) #6
  %75 = or i32 %74, %67
  %76 = load ptr, ptr %16, align 8
  %77 = load ptr, ptr %12, align 8
  %78 = tail call i32 %76(ptr noundef %77, i64 noundef %50) #6
  %79 = icmp eq i32 %78, 2
  %80 = select i1 %79, i32 0, i32 %78
  %81 = or i32 %75, %80
  call void @llvm.lifetime.end.p0(i64 24, ptr nonnull %2) #6
  %82 = icmp eq i32 %81, 0
  br i1 %82, label %85, label %83

83:                                               ; preds = %70
  %84 = sext i32 %81 to i64
  br label %245

85:                                               ; preds = %70
  %86 = load atomic i64, ptr %0 acquire, align 8
  %87 = inttoptr i64 %86 to ptr
  store atomic i64 %86, ptr %3 release, align 8
  %88 = load ptr, ptr %8, align 8
  %89 = icmp eq ptr %88, null
  br i1 %89, label %130, label %90

90:                                               ; preds = %85
  %91 = load ptr, ptr %18, align 8
  br label %92

92:                                               ; preds = %90, %124
  %93 = phi ptr [ %110, %124 ], [ %91, %90 ]
  %94 = phi ptr [ %126, %124 ], [ %88, %90 ]
  %95 = phi i32 [ %125, %124 ], [ 0, %90 ]
  %96 = load ptr, ptr %17, align 8
  %97 = load ptr, ptr %19, align 8
  %98 = tail call i32 %96(ptr noundef nonnull %94, ptr noundef %93, ptr noundef %97, ptr noundef null) #6
  switch i32 %98, label %99 [
    i32 401, label %130
    i32 0, label %109
  ]

99:                                               ; preds = %92
  %100 = atomicrmw add ptr %22, i64 1 seq_cst, align 8
  %101 = load i64, ptr %20, align 8
  %102 = add nsw i64 %101, 1
  store i64 %102, ptr %20, align 8
  %103 = load ptr, ptr %23, align 8
  %104 = tail call i32 %103(i32 noundef 1000) #6
  %105 = load i64, ptr %20, align 8
  %106 = icmp sgt i64 %105, 999
  br i1 %106, label %107, label %130

107:                                              ; preds = %99
  %108 = sext i32 %98 to i64
  store i64 %108, ptr %24, align 8
  br label %130

109:                                              ; preds = %92
  store i64 0, ptr %20, align 8
  %110 = load ptr, ptr %18, align 8
  %111 = getelementptr inbounds %struct.message, ptr %110, i64 0, i32 1
  %112 = load i64, ptr %111, align 8
  %113 = icmp sgt i64 %112, 11
  br i1 %113, label %114, label %124

114:                                              ; preds = %109
  %115 = load ptr, ptr %110, align 8
  %116 = getelementptr inbounds i8, ptr %115, i64 4
  %117 = load i32, ptr %116, align 1
  %118 = getelementptr inbounds i8, ptr %115, i64 8
  %119 = load i32, ptr %118, align 1
  %120 = sext i32 %117 to i64
  %121 = mul nsw i64 %120, 1000000000
  %122 = zext i32 %119 to i64
  %123 = add nsw i64 %121, %122
  store i64 %123, ptr %21, align 8
  br label %124

124:                                              ; preds = %109, %114
  %125 = add nuw nsw i32 %95, 1
  %126 = load ptr, ptr %8, align 8
  %127 = icmp ne ptr %126, null
  %128 = icmp ult i32 %95, 63
  %129 = select i1 %127, i1 %128, i1 false
  br i1 %129, label %92, label %130, !llvm.loop !10

130:                                              ; preds = %92, %124, %85, %99, %107
  %131 = load ptr, ptr %6, align 8
  %132 = icmp eq ptr %131, null
  br i1 %132, label %196, label %133

133:                                              ; preds = %130, %190
  %134 = phi ptr [ %192, %190 ], [ %131, %130 ]
  %135 = phi i32 [ %191, %190 ], [ 0, %130 ]
  %136 = load ptr, ptr %17, align 8
  %137 = load ptr, ptr %25, align 8
  %138 = load ptr, ptr %26, align 8
  %139 = tail call i32 %136(ptr noundef nonnull %134, ptr noundef %137, ptr noundef %138, ptr noundef null) #6
  switch i32 %139, label %140 [
    i32 401, label %196
    i32 0, label %150
  ]

140:                                              ; preds = %133
  %141 = atomicrmw add ptr %22, i64 1 seq_cst, align 8
  %142 = load i64, ptr %27, align 8
  %143 = add nsw i64 %142, 1
  store i64 %143, ptr %27, align 8
  %144 = load ptr, ptr %23, align 8
  %145 = tail call i32 %144(i32 noundef 1000) #6
  %146 = load i64, ptr %27, align 8
  %147 = icmp sgt i64 %146, 999
  br i1 %147, label %148, label %196

148:                                              ; preds = %140
  %149 = sext i32 %139 to i64
  store i64 %149, ptr %24, align 8
  br label %196

150:                                              ; preds = %133
  store i64 0, ptr %27, align 8
  %151 = load ptr, ptr %25, align 8
  %152 = load ptr, ptr %151, align 8
  %153 = getelementptr inbounds %struct.message, ptr %151, i64 0, i32 1
  %154 = load i64, ptr %153, align 8
  %155 = load ptr, ptr %26, align 8
  %156 = getelementptr inbounds i64, ptr %155, i64 1
  %157 = load i64, ptr %156, align 8
  %158 = load atomic i64, ptr %28 acquire, align 8
  %159 = icmp eq i64 %158, 0
  br i1 %159, label %162, label %160

160:                                              ; preds = %150
  %161 = load i64, ptr %21, align 8
  br label %162

162:                                              ; preds = %160, %150
  %163 = phi i64 [ %161, %160 ], [ %157, %150 ]
  %164 = icmp sgt i64 %154, 11
  br i1 %164, label %165, label %190

165:                                              ; preds = %162
  %166 = getelementptr inbounds i8, ptr %152, i64 1
  %167 = load i8, ptr %166, align 1
  %168 = icmp eq i8 %167, 1
  %169 = icmp sgt i64 %163, 0
  %170 = select i1 %168, i1 %169, i1 false
  br i1 %170, label %171, label %190

171:                                              ; preds = %165
  %172 = getelementptr inbounds i8, ptr %152, i64 4
  %173 = load i32, ptr %172, align 1
  %174 = getelementptr inbounds i8, ptr %152, i64 8
  %175 = load i32, ptr %174, align 1
  %176 = sext i32 %173 to i64
  %177 = mul nsw i64 %176, 1000000000
  %178 = zext i32 %175 to i64
  %179 = sub nsw i64 0, %178
  %180 = icmp eq i64 %177, %179
  br i1 %180, label %181, label %190

181:                                              ; preds = %171
  %182 = load ptr, ptr %25, align 8
  %183 = load ptr, ptr %182, align 8
  %184 = getelementptr inbounds i8, ptr %183, i64 4
  %185 = udiv i64 %163, 1000000000
  %186 = trunc i64 %185 to i32
  %187 = urem i64 %163, 1000000000
  %188 = trunc i64 %187 to i32
  store i32 %186, ptr %184, align 1
  %189 = getelementptr inbounds i8, ptr %183, i64 8
  store i32 %188, ptr %189, align 1
  br label %190

190:                                              ; preds = %162, %165, %171, %181
  tail call void @cycle(ptr noundef nonnull %0, ptr noundef %87, ptr noundef %152, i64 noundef %154)
  %191 = add nuw nsw i32 %135, 1
  %192 = load ptr, ptr %6, align 8
  %193 = icmp ne ptr %192, null
  %194 = icmp ult i32 %135, 63
  %195 = select i1 %193, i1 %194, i1 false
  br i1 %195, label %133, label %196, !llvm.loop !10

196:                                              ; preds = %133, %190, %130, %140, %148
  %197 = load ptr, ptr %10, align 8
  %198 = icmp eq ptr %197, null
  br i1 %198, label %226, label %199

199:                                              ; preds = %196, %216
  %200 = phi ptr [ %222, %216 ], [ %197, %196 ]
  %201 = phi i32 [ %221, %216 ], [ 0, %196 ]
  %202 = load ptr, ptr %17, align 8
  %203 = load ptr, ptr %29, align 8
  %204 = load ptr, ptr %30, align 8
  %205 = tail call i32 %202(ptr noundef nonnull %200, ptr noundef %203, ptr noundef %204, ptr noundef null) #6
  switch i32 %205, label %206 [
    i32 401, label %226
    i32 0, label %216
  ]

206:                                              ; preds = %199
  %207 = atomicrmw add ptr %22, i64 1 seq_cst, align 8
  %208 = load i64, ptr %31, align 8
  %209 = add nsw i64 %208, 1
  store i64 %209, ptr %31, align 8
  %210 = load ptr, ptr %23, align 8
  %211 = tail call i32 %210(i32 noundef 1000) #6
  %212 = load i64, ptr %31, align 8
  %213 = icmp sgt i64 %212, 999
  br i1 %213, label %214, label %226

214:                                              ; preds = %206
  %215 = sext i32 %205 to i64
  store i64 %215, ptr %24, align 8
  br label %226

216:                                              ; preds = %199
  store i64 0, ptr %31, align 8
  %217 = load ptr, ptr %29, align 8
  %218 = load ptr, ptr %217, align 8
  %219 = getelementptr inbounds %struct.message, ptr %217, i64 0, i32 1
  %220 = load i64, ptr %219, align 8
  tail call void @hear(ptr noundef nonnull %0, ptr noundef %87, ptr noundef %218, i64 noundef %220) #6, !callees !11
  %221 = add nuw nsw i32 %201, 1
  %222 = load ptr, ptr %10, align 8
  %223 = icmp ne ptr %222, null
  %224 = icmp ult i32 %201, 63
  %225 = select i1 %223, i1 %224, i1 false
  br i1 %225, label %199, label %226, !llvm.loop !10

226:                                              ; preds = %199, %216, %196, %206, %214
  tail call void @look_at_time(ptr noundef nonnull %0, ptr noundef %87)
  %227 = load atomic i64, ptr %32 seq_cst, align 8
  %228 = icmp eq i64 %227, 0
  br i1 %228, label %231, label %229

229:                                              ; preds = %226
  %230 = load atomic i64, ptr %32 seq_cst, align 8
  br label %233

231:                                              ; preds = %226
  %232 = load i64, ptr %24, align 8
  br label %233

233:                                              ; preds = %231, %229
  %234 = phi i64 [ %230, %229 ], [ %232, %231 ]
  %235 = load atomic i64, ptr %32 seq_cst, align 8
  %236 = icmp eq i64 %235, 0
  br i1 %236, label %241, label %237

237:                                              ; preds = %233
  %238 = getelementptr inbounds %struct.plan, ptr %87, i64 0, i32 15
  %239 = load ptr, ptr %238, align 8
  %240 = icmp ne ptr %239, null
  br label %241

241:                                              ; preds = %233, %237
  %242 = phi i1 [ false, %233 ], [ %240, %237 ]
  %243 = zext i1 %242 to i8
  %244 = icmp eq i64 %234, 0
  br i1 %244, label %33, label %245

245:                                              ; preds = %241, %83
  %246 = phi i8 [ %34, %83 ], [ %243, %241 ]
  %247 = phi i64 [ %84, %83 ], [ %234, %241 ]
  %248 = icmp eq i8 %246, 0
  br i1 %248, label %249, label %260

249:                                              ; preds = %245
  %250 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 20
  %251 = load ptr, ptr %250, align 8
  %252 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 23
  %253 = load i64, ptr %252, align 8
  %254 = shl i64 %253, 3
  tail call void @llvm.memset.p0.i64(ptr align 8 %251, i8 0, i64 %254, i1 false)
  %255 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 18
  %256 = load ptr, ptr %255, align 8
  %257 = getelementptr inbounds %struct.path_head, ptr %256, i64 0, i32 1
  store double 1.000000e+00, ptr %257, align 8
  %258 = load ptr, ptr %255, align 8
  %259 = getelementptr inbounds %struct.path_head, ptr %258, i64 0, i32 3
  store double 0.000000e+00, ptr %259, align 8
  tail call fastcc void @publish_result(ptr noundef nonnull %0)
  br label %260

260:                                              ; preds = %249, %245
  %261 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 3
  store atomic i64 %247, ptr %261 release, align 8
  br label %262

262:                                              ; preds = %33, %260
  ret ptr null
}

; Function Attrs: argmemonly mustprogress nocallback nofree nounwind willreturn writeonly
declare void @llvm.memset.p0.i64(ptr nocapture writeonly, i8, i64, i1 immarg) #3

; Function Attrs: argmemonly mustprogress nofree norecurse nounwind willreturn
define dso_local void @write_number(ptr nocapture noundef writeonly %0, i64 noundef %1) local_unnamed_addr #4 {
  store atomic i64 %1, ptr %0 release, align 8
  ret void
}

; Function Attrs: argmemonly mustprogress nofree norecurse nounwind willreturn
define dso_local i64 @read_number(ptr nocapture noundef readonly %0) local_unnamed_addr #4 {
  %2 = load atomic i64, ptr %0 acquire, align 8
  ret i64 %2
}

; Function Attrs: nounwind
define dso_local void @repeat_cycles(ptr noundef %0, ptr nocapture noundef %1, i64 noundef %2, i64 noundef %3, ptr nocapture noundef writeonly %4, i1 noundef zeroext %5) local_unnamed_addr #0 {
  %7 = alloca [2 x i64], align 16
  %8 = alloca i64, align 8
  %9 = alloca [2 x i64], align 16
  %10 = load atomic i64, ptr %0 monotonic, align 8
  %11 = inttoptr i64 %10 to ptr
  %12 = icmp sgt i64 %3, 0
  br i1 %12, label %13, label %25

13:                                               ; preds = %6
  %14 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 49
  %15 = getelementptr inbounds [2 x i64], ptr %9, i64 0, i64 1
  %16 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 17
  %17 = getelementptr inbounds i8, ptr %1, i64 4
  %18 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 28
  %19 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 29
  %20 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 48
  %21 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 41
  %22 = getelementptr inbounds %struct.block, ptr %0, i64 0, i32 14
  %23 = getelementptr inbounds i8, ptr %1, i64 8
  %24 = getelementptr inbounds [2 x i64], ptr %7, i64 0, i64 1
  br label %26

25:                                               ; preds = %62, %6
  ret void

26:                                               ; preds = %13, %62
  %27 = phi i64 [ 0, %13 ], [ %71, %62 ]
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %9) #6
  %28 = load ptr, ptr %14, align 8
  %29 = call i32 %28(i32 noundef 1, ptr noundef nonnull %9) #6
  %30 = load i64, ptr %9, align 16
  %31 = mul nsw i64 %30, 1000000000
  %32 = load i64, ptr %15, align 8
  %33 = add nsw i64 %31, %32
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %9) #6
  %34 = sitofp i64 %33 to double
  %35 = load ptr, ptr %16, align 8
  %36 = getelementptr inbounds %struct.event, ptr %35, i64 0, i32 5
  store double %34, ptr %36, align 8
  call void @llvm.lifetime.start.p0(i64 8, ptr nonnull %8) #6
  store i64 0, ptr %8, align 8
  %37 = load atomic i64, ptr %18 acquire, align 8
  %38 = icmp eq i64 %37, 0
  br i1 %38, label %41, label %39

39:                                               ; preds = %26
  %40 = load i64, ptr %19, align 8
  store i64 %40, ptr %8, align 8
  br label %46

41:                                               ; preds = %26
  %42 = load ptr, ptr %20, align 8
  %43 = load ptr, ptr %21, align 8
  %44 = call i32 %42(ptr noundef %43, ptr noundef nonnull %8) #6
  %45 = load i64, ptr %8, align 8
  br label %46

46:                                               ; preds = %39, %41
  %47 = phi i64 [ %45, %41 ], [ %40, %39 ]
  %48 = icmp ne i64 %47, 0
  %49 = uitofp i1 %48 to double
  %50 = load ptr, ptr %16, align 8
  %51 = getelementptr inbounds %struct.event, ptr %50, i64 0, i32 4
  store double %49, ptr %51, align 8
  %52 = load i64, ptr %22, align 8
  %53 = sub nsw i64 %47, %52
  %54 = sitofp i64 %53 to double
  %55 = load ptr, ptr %16, align 8
  store double %54, ptr %55, align 8
  %56 = load i64, ptr %8, align 8
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %8) #6
  %57 = sdiv i64 %56, 1000000000
  %58 = trunc i64 %57 to i32
  %59 = srem i64 %56, 1000000000
  %60 = trunc i64 %59 to i32
  store i32 %58, ptr %17, align 1
  store i32 %60, ptr %23, align 1
  br i1 %5, label %61, label %62

61:                                               ; preds = %46
  call void @cycle(ptr noundef nonnull %0, ptr noundef %11, ptr noundef nonnull %1, i64 noundef %2)
  br label %62

62:                                               ; preds = %61, %46
  call void @llvm.lifetime.start.p0(i64 16, ptr nonnull %7) #6
  %63 = load ptr, ptr %14, align 8
  %64 = call i32 %63(i32 noundef 1, ptr noundef nonnull %7) #6
  %65 = load i64, ptr %7, align 16
  %66 = mul nsw i64 %65, 1000000000
  %67 = load i64, ptr %24, align 8
  call void @llvm.lifetime.end.p0(i64 16, ptr nonnull %7) #6
  %68 = sub i64 %67, %33
  %69 = add i64 %68, %66
  %70 = getelementptr inbounds i64, ptr %4, i64 %27
  store i64 %69, ptr %70, align 8
  %71 = add nuw nsw i64 %27, 1
  %72 = icmp eq i64 %71, %3
  br i1 %72, label %25, label %26, !llvm.loop !12
}

; Function Attrs: argmemonly mustprogress nocallback nofree nounwind willreturn
declare void @llvm.memmove.p0.p0.i64(ptr nocapture writeonly, ptr nocapture readonly, i64, i1 immarg) #2

; Function Attrs: nocallback nofree nosync nounwind readnone speculatable willreturn
declare i64 @llvm.smin.i64(i64, i64) #5

attributes #0 = { nounwind }
attributes #1 = { argmemonly mustprogress nocallback nofree nosync nounwind willreturn }
attributes #2 = { argmemonly mustprogress nocallback nofree nounwind willreturn }
attributes #3 = { argmemonly mustprogress nocallback nofree nounwind willreturn writeonly }
attributes #4 = { argmemonly mustprogress nofree norecurse nounwind willreturn }
attributes #5 = { nocallback nofree nosync nounwind readnone speculatable willreturn }
attributes #6 = { nounwind }

!llvm.module.flags = !{!0}

!0 = !{i32 1, !"wchar_size", i32 4}
!1 = distinct !{!1, !2, !3}
!2 = !{!"llvm.loop.mustprogress"}
!3 = !{!"llvm.loop.unroll.disable"}
!4 = distinct !{!4, !2, !3}
!5 = distinct !{!5, !2, !3}
!6 = distinct !{!6, !2, !3}
!7 = distinct !{!7, !2, !3}
!8 = distinct !{!8, !2, !3}
!9 = distinct !{!9, !2, !3}
!10 = distinct !{!10, !2, !3}
!11 = distinct !{null, ptr @hear, null}
!12 = distinct !{!12, !2, !3}
