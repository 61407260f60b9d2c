
%struct.array = type { %struct.object, ptr, i32, i32, ptr, ptr, ptr, ptr, i32, i32, ptr }
%struct.object = type { i32, i32, ptr }
%struct.table = type { ptr, ptr, ptr, ptr, ptr, i64, ptr, i64, i64, i64, ptr, i64, i64, ptr, i64, ptr, ptr, ptr, ptr }
%struct.interpreter = type { ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr }
%struct.argument = type { i64, i64, i64, ptr, double, i64, ptr, ptr }
%struct.tuple = type { %struct.object, i64, [0 x ptr] }
%struct.real = type { %struct.object, double }
%struct.part = type { i64, ptr, i64, i64, i64, i64 }
%struct.lanes = type { ptr, ptr, i64 }
%struct.list = type { %struct.object, i64, ptr }

@refusal = internal unnamed_addr global ptr null, align 8

; Function Attrs: nounwind
define dso_local ptr @entry(ptr nocapture noundef readonly %0, ptr noundef %1, i64 noundef %2, ptr noundef %3) local_unnamed_addr #0 {
  %5 = alloca [32 x ptr], align 16
  %6 = alloca [32 x ptr], align 16
  %7 = alloca double, align 8
  %8 = alloca [4 x ptr], align 16
  %9 = getelementptr inbounds %struct.array, ptr %0, i64 0, i32 1
  %10 = load ptr, ptr %9, align 8
  %11 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 1
  %12 = load ptr, ptr %11, align 8
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %5) #8
  %13 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 7
  %14 = load i64, ptr %13, align 8
  %15 = icmp eq i64 %14, 0
  br i1 %15, label %106, label %16

16:                                               ; preds = %4
  %17 = getelementptr inbounds %struct.interpreter, ptr %12, i64 0, i32 8
  %18 = load ptr, ptr %17, align 8
  %19 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 5
  %20 = load i64, ptr %19, align 8
  %21 = icmp sgt i64 %20, 0
  br i1 %21, label %22, label %47

22:                                               ; preds = %16
  %23 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 6
  %24 = load ptr, ptr %23, align 8
  br label %25

25:                                               ; preds = %44, %22
  %26 = phi i64 [ 0, %22 ], [ %45, %44 ]
  %27 = getelementptr inbounds %struct.argument, ptr %24, i64 %26
  %28 = getelementptr inbounds %struct.argument, ptr %24, i64 %26, i32 7
  %29 = load ptr, ptr %28, align 8
  %30 = getelementptr inbounds ptr, ptr %5, i64 %26
  store ptr %29, ptr %30, align 8
  %31 = icmp slt i64 %26, %2
  %32 = load i64, ptr %27, align 8
  br i1 %31, label %33, label %42

33:                                               ; preds = %25
  %34 = icmp sgt i64 %32, 1
  br i1 %34, label %104, label %35

35:                                               ; preds = %33
  %36 = icmp ne i64 %32, 0
  %37 = getelementptr inbounds ptr, ptr %1, i64 %26
  %38 = load ptr, ptr %37, align 8
  %39 = icmp eq ptr %38, %18
  %40 = select i1 %36, i1 %39, i1 false
  br i1 %40, label %44, label %41

41:                                               ; preds = %35
  store ptr %38, ptr %30, align 8
  br label %44

42:                                               ; preds = %25
  %43 = icmp eq i64 %32, 0
  br i1 %43, label %104, label %44

44:                                               ; preds = %42, %41, %35
  %45 = add nuw nsw i64 %26, 1
  %46 = icmp eq i64 %45, %20
  br i1 %46, label %47, label %25, !llvm.loop !1

47:                                               ; preds = %44, %16
  %48 = icmp slt i64 %20, %2
  br i1 %48, label %104, label %49

49:                                               ; preds = %47
  %50 = icmp eq ptr %3, null
  br i1 %50, label %58, label %51

51:                                               ; preds = %49
  %52 = getelementptr inbounds %struct.tuple, ptr %3, i64 0, i32 1
  %53 = load i64, ptr %52, align 8
  %54 = icmp sgt i64 %53, 0
  br i1 %54, label %55, label %58

55:                                               ; preds = %51
  %56 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 6
  %57 = icmp sgt i64 %20, %2
  br label %63

58:                                               ; preds = %91, %51, %49
  br i1 %21, label %60, label %59

59:                                               ; preds = %58
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %6) #8
  br label %253

60:                                               ; preds = %58
  %61 = load ptr, ptr %5, align 16
  %62 = icmp eq ptr %61, null
  br i1 %62, label %104, label %94

63:                                               ; preds = %91, %55
  %64 = phi i64 [ 0, %55 ], [ %92, %91 ]
  %65 = getelementptr inbounds %struct.tuple, ptr %3, i64 0, i32 2, i64 %64
  %66 = load ptr, ptr %65, align 8
  br i1 %57, label %67, label %81

67:                                               ; preds = %63
  %68 = load ptr, ptr %56, align 8
  br label %69

69:                                               ; preds = %78, %67
  %70 = phi i64 [ %2, %67 ], [ %79, %78 ]
  %71 = getelementptr inbounds %struct.argument, ptr %68, i64 %70, i32 6
  %72 = load ptr, ptr %71, align 8
  %73 = icmp eq ptr %72, %66
  br i1 %73, label %74, label %78

74:                                               ; preds = %69
  %75 = getelementptr inbounds %struct.argument, ptr %68, i64 %70
  %76 = load i64, ptr %75, align 8
  %77 = icmp eq i64 %76, 4
  br i1 %77, label %78, label %81

78:                                               ; preds = %74, %69
  %79 = add i64 %70, 1
  %80 = icmp eq i64 %79, %20
  br i1 %80, label %104, label %69, !llvm.loop !4

81:                                               ; preds = %74, %63
  %82 = phi i64 [ %2, %63 ], [ %70, %74 ]
  %83 = icmp eq i64 %82, %20
  br i1 %83, label %104, label %84

84:                                               ; preds = %81
  %85 = add nsw i64 %64, %2
  %86 = getelementptr inbounds ptr, ptr %1, i64 %85
  %87 = load ptr, ptr %86, align 8
  %88 = icmp eq ptr %87, %18
  br i1 %88, label %91, label %89

89:                                               ; preds = %84
  %90 = getelementptr inbounds ptr, ptr %5, i64 %82
  store ptr %87, ptr %90, align 8
  br label %91

91:                                               ; preds = %89, %84
  %92 = add nuw nsw i64 %64, 1
  %93 = icmp eq i64 %92, %53
  br i1 %93, label %58, label %63, !llvm.loop !5

94:                                               ; preds = %60, %98
  %95 = phi i64 [ %96, %98 ], [ 0, %60 ]
  %96 = add nuw nsw i64 %95, 1
  %97 = icmp eq i64 %96, %20
  br i1 %97, label %102, label %98, !llvm.loop !6

98:                                               ; preds = %94
  %99 = getelementptr inbounds ptr, ptr %5, i64 %96
  %100 = load ptr, ptr %99, align 8
  %101 = icmp eq ptr %100, null
  br i1 %101, label %102, label %94, !llvm.loop !6

102:                                              ; preds = %98, %94
  %103 = icmp slt i64 %96, %20
  br i1 %103, label %104, label %117

104:                                              ; preds = %42, %33, %81, %78, %60, %47, %102
  %105 = tail call fastcc ptr @otherwise(ptr noundef %0, ptr noundef %1, i64 noundef %2, ptr noundef %3)
  br label %553

106:                                              ; preds = %4
  %107 = icmp eq ptr %3, null
  br i1 %107, label %108, label %115

108:                                              ; preds = %106
  %109 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 5
  %110 = load i64, ptr %109, align 8
  %111 = sub nsw i64 %2, %110
  %112 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 8
  %113 = load i64, ptr %112, align 8
  %114 = icmp ugt i64 %111, %113
  br i1 %114, label %115, label %117

115:                                              ; preds = %108, %106
  %116 = tail call fastcc ptr @otherwise(ptr noundef nonnull %0, ptr noundef %1, i64 noundef %2, ptr noundef %3)
  br label %553

117:                                              ; preds = %102, %108
  %118 = phi i64 [ %110, %108 ], [ %20, %102 ]
  %119 = phi ptr [ %1, %108 ], [ %5, %102 ]
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %6) #8
  %120 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 5
  %121 = icmp sgt i64 %118, 0
  br i1 %121, label %122, label %253

122:                                              ; preds = %117
  %123 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 6
  %124 = getelementptr inbounds %struct.interpreter, ptr %12, i64 0, i32 2
  %125 = getelementptr inbounds %struct.interpreter, ptr %12, i64 0, i32 1
  br label %126

126:                                              ; preds = %122, %247
  %127 = phi i64 [ 0, %122 ], [ %250, %247 ]
  %128 = load ptr, ptr %123, align 8
  %129 = getelementptr inbounds %struct.argument, ptr %128, i64 %127
  %130 = getelementptr inbounds ptr, ptr %119, i64 %127
  %131 = load ptr, ptr %130, align 8
  %132 = load i64, ptr %129, align 8
  switch i64 %132, label %149 [
    i64 3, label %136
    i64 4, label %133
  ]

133:                                              ; preds = %126
  %134 = getelementptr inbounds %struct.array, ptr %131, i64 0, i32 1
  %135 = load ptr, ptr %134, align 8
  br label %247

136:                                              ; preds = %126
  %137 = getelementptr inbounds %struct.object, ptr %131, i64 0, i32 2
  %138 = load ptr, ptr %137, align 8
  %139 = load ptr, ptr %124, align 8
  %140 = icmp eq ptr %138, %139
  br i1 %140, label %141, label %147

141:                                              ; preds = %136
  %142 = getelementptr inbounds %struct.real, ptr %131, i64 0, i32 1
  %143 = load double, ptr %142, align 8
  %144 = fcmp ult double %143, 0.000000e+00
  %145 = fcmp ogt double %143, 0x7FEFFFFFFFFFFFFF
  %146 = or i1 %144, %145
  br i1 %146, label %147, label %247

147:                                              ; preds = %141, %136
  %148 = tail call fastcc ptr @otherwise(ptr noundef %0, ptr noundef %1, i64 noundef %2, ptr noundef %3)
  br label %551

149:                                              ; preds = %126
  %150 = getelementptr inbounds %struct.argument, ptr %128, i64 %127, i32 1
  %151 = load i64, ptr %150, align 8
  %152 = getelementptr inbounds %struct.argument, ptr %128, i64 %127, i32 5
  %153 = load i64, ptr %152, align 8
  %154 = getelementptr inbounds %struct.object, ptr %131, i64 0, i32 2
  %155 = load ptr, ptr %154, align 8
  %156 = load ptr, ptr %12, align 8
  %157 = icmp eq ptr %155, %156
  br i1 %157, label %158, label %245

158:                                              ; preds = %149
  %159 = getelementptr inbounds %struct.array, ptr %131, i64 0, i32 2
  %160 = load i32, ptr %159, align 8
  %161 = sext i32 %160 to i64
  %162 = icmp eq i64 %151, %161
  br i1 %162, label %163, label %245

163:                                              ; preds = %158
  %164 = getelementptr inbounds %struct.array, ptr %131, i64 0, i32 7
  %165 = load ptr, ptr %164, align 8
  %166 = load ptr, ptr %125, align 8
  %167 = icmp eq ptr %165, %166
  br i1 %167, label %168, label %245

168:                                              ; preds = %163
  %169 = getelementptr inbounds %struct.array, ptr %131, i64 0, i32 8
  %170 = load i32, ptr %169, align 8
  %171 = sext i32 %170 to i64
  %172 = and i64 %153, %171
  %173 = icmp eq i64 %172, %153
  br i1 %173, label %174, label %245

174:                                              ; preds = %168
  %175 = getelementptr inbounds %struct.argument, ptr %128, i64 %127, i32 3
  %176 = load ptr, ptr %175, align 8
  %177 = icmp sgt i64 %151, 0
  br i1 %177, label %178, label %196

178:                                              ; preds = %174
  %179 = getelementptr inbounds %struct.array, ptr %131, i64 0, i32 4
  %180 = load ptr, ptr %179, align 8
  %181 = load i64, ptr %180, align 8
  %182 = load i64, ptr %176, align 8
  %183 = icmp eq i64 %181, %182
  br i1 %183, label %184, label %245

184:                                              ; preds = %178, %188
  %185 = phi i64 [ %186, %188 ], [ 0, %178 ]
  %186 = add nuw nsw i64 %185, 1
  %187 = icmp eq i64 %186, %151
  br i1 %187, label %194, label %188, !llvm.loop !7

188:                                              ; preds = %184
  %189 = getelementptr inbounds i64, ptr %180, i64 %186
  %190 = load i64, ptr %189, align 8
  %191 = getelementptr inbounds i64, ptr %176, i64 %186
  %192 = load i64, ptr %191, align 8
  %193 = icmp eq i64 %190, %192
  br i1 %193, label %184, label %194, !llvm.loop !7

194:                                              ; preds = %188, %184
  %195 = icmp slt i64 %186, %151
  br i1 %195, label %245, label %196

196:                                              ; preds = %174, %194
  %197 = getelementptr inbounds %struct.array, ptr %131, i64 0, i32 1
  %198 = load ptr, ptr %197, align 8
  %199 = getelementptr inbounds %struct.argument, ptr %128, i64 %127, i32 2
  %200 = load i64, ptr %199, align 8
  %201 = getelementptr inbounds %struct.argument, ptr %128, i64 %127, i32 4
  %202 = load double, ptr %201, align 8
  %203 = icmp slt i64 %200, 4
  br i1 %203, label %204, label %217

204:                                              ; preds = %196
  %205 = icmp sgt i64 %200, 0
  br i1 %205, label %206, label %247

206:                                              ; preds = %204, %206
  %207 = phi i8 [ %214, %206 ], [ 1, %204 ]
  %208 = phi i64 [ %215, %206 ], [ 0, %204 ]
  %209 = getelementptr inbounds double, ptr %198, i64 %208
  %210 = load double, ptr %209, align 8
  %211 = tail call double @llvm.fabs.f64(double %210)
  %212 = fcmp ole double %211, %202
  %213 = zext i1 %212 to i8
  %214 = and i8 %207, %213
  %215 = add nuw nsw i64 %208, 1
  %216 = icmp eq i64 %215, %200
  br i1 %216, label %243, label %206, !llvm.loop !8

217:                                              ; preds = %196
  %218 = insertelement <4 x double> undef, double %202, i64 0
  %219 = shufflevector <4 x double> %218, <4 x double> poison, <4 x i32> zeroinitializer
  %220 = add nsw i64 %200, -4
  br label %230

221:                                              ; preds = %230
  %222 = extractelement <4 x i64> %241, i64 0
  %223 = extractelement <4 x i64> %241, i64 1
  %224 = and i64 %222, %223
  %225 = extractelement <4 x i64> %241, i64 2
  %226 = and i64 %224, %225
  %227 = extractelement <4 x i64> %241, i64 3
  %228 = and i64 %226, %227
  %229 = icmp eq i64 %228, 0
  br i1 %229, label %245, label %247

230:                                              ; preds = %230, %217
  %231 = phi i64 [ 0, %217 ], [ %233, %230 ]
  %232 = phi <4 x i64> [ <i64 -1, i64 -1, i64 -1, i64 -1>, %217 ], [ %241, %230 ]
  %233 = add nuw nsw i64 %231, 4
  %234 = icmp sgt i64 %233, %200
  %235 = select i1 %234, i64 %220, i64 %231
  %236 = getelementptr inbounds double, ptr %198, i64 %235
  %237 = load <4 x i64>, ptr %236, align 8
  %238 = and <4 x i64> %237, <i64 9223372036854775807, i64 9223372036854775807, i64 9223372036854775807, i64 9223372036854775807>
  %239 = bitcast <4 x i64> %238 to <4 x double>
  %240 = fcmp oge <4 x double> %219, %239
  %241 = select <4 x i1> %240, <4 x i64> %232, <4 x i64> zeroinitializer
  %242 = icmp slt i64 %233, %200
  br i1 %242, label %230, label %221, !llvm.loop !9

243:                                              ; preds = %206
  %244 = icmp eq i8 %214, 0
  br i1 %244, label %245, label %247

245:                                              ; preds = %178, %149, %158, %163, %221, %243, %194, %168
  %246 = tail call fastcc ptr @otherwise(ptr noundef %0, ptr noundef %1, i64 noundef %2, ptr noundef %3)
  br label %551

247:                                              ; preds = %243, %221, %204, %133, %141
  %248 = phi ptr [ %142, %141 ], [ %135, %133 ], [ %198, %204 ], [ %198, %221 ], [ %198, %243 ]
  %249 = getelementptr inbounds [32 x ptr], ptr %6, i64 0, i64 %127
  store ptr %248, ptr %249, align 8
  %250 = add nuw nsw i64 %127, 1
  %251 = load i64, ptr %120, align 8
  %252 = icmp slt i64 %250, %251
  br i1 %252, label %126, label %253, !llvm.loop !10

253:                                              ; preds = %247, %59, %117
  %254 = phi i64 [ %118, %117 ], [ %20, %59 ], [ %251, %247 ]
  %255 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 9
  %256 = load i64, ptr %255, align 8
  %257 = add nsw i64 %256, -1
  %258 = icmp slt i64 %254, %257
  br i1 %258, label %259, label %261

259:                                              ; preds = %253
  %260 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 10
  br label %266

261:                                              ; preds = %266, %253
  %262 = phi i64 [ %257, %253 ], [ %274, %266 ]
  %263 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 12
  %264 = load i64, ptr %263, align 8
  %265 = icmp eq i64 %264, 0
  br i1 %265, label %276, label %291

266:                                              ; preds = %259, %266
  %267 = phi i64 [ %254, %259 ], [ %272, %266 ]
  %268 = load ptr, ptr %260, align 8
  %269 = getelementptr inbounds ptr, ptr %268, i64 %267
  %270 = load ptr, ptr %269, align 8
  %271 = getelementptr inbounds [32 x ptr], ptr %6, i64 0, i64 %267
  store ptr %270, ptr %271, align 8
  %272 = add nsw i64 %267, 1
  %273 = load i64, ptr %255, align 8
  %274 = add nsw i64 %273, -1
  %275 = icmp slt i64 %272, %274
  br i1 %275, label %266, label %261, !llvm.loop !11

276:                                              ; preds = %261
  call void @llvm.lifetime.start.p0(i64 8, ptr nonnull %7) #8
  %277 = getelementptr inbounds [32 x ptr], ptr %6, i64 0, i64 %262
  store ptr %7, ptr %277, align 8
  %278 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 4
  %279 = load ptr, ptr %278, align 8
  call void %279(ptr noundef nonnull %6) #8
  %280 = load double, ptr %7, align 8
  %281 = call double @llvm.fabs.f64(double %280)
  %282 = fcmp ugt double %281, 0x7FEFFFFFFFFFFFFF
  br i1 %282, label %283, label %285

283:                                              ; preds = %276
  %284 = call fastcc ptr @otherwise(ptr noundef %0, ptr noundef %1, i64 noundef %2, ptr noundef %3)
  br label %289

285:                                              ; preds = %276
  %286 = getelementptr inbounds %struct.interpreter, ptr %12, i64 0, i32 11
  %287 = load ptr, ptr %286, align 8
  %288 = call ptr %287(double noundef %280) #8
  br label %289

289:                                              ; preds = %285, %283
  %290 = phi ptr [ %288, %285 ], [ %284, %283 ]
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %7) #8
  br label %551

291:                                              ; preds = %261
  call void @llvm.lifetime.start.p0(i64 32, ptr nonnull %8) #8
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 16 dereferenceable(32) %8, i8 0, i64 32, i1 false)
  %292 = icmp sgt i64 %264, 0
  br i1 %292, label %295, label %293

293:                                              ; preds = %291
  %294 = load ptr, ptr %8, align 16
  br label %428

295:                                              ; preds = %291
  %296 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 13
  %297 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 16
  br label %298

298:                                              ; preds = %295, %393
  %299 = phi i64 [ 0, %295 ], [ %396, %393 ]
  %300 = load ptr, ptr %296, align 8
  %301 = getelementptr inbounds %struct.part, ptr %300, i64 %299
  %302 = load ptr, ptr %297, align 8
  %303 = shl nuw nsw i64 %299, 1
  %304 = getelementptr inbounds ptr, ptr %302, i64 %303
  %305 = load ptr, ptr %11, align 8
  %306 = getelementptr inbounds %struct.interpreter, ptr %305, i64 0, i32 1
  %307 = getelementptr inbounds %struct.part, ptr %300, i64 %299, i32 1
  br label %308

308:                                              ; preds = %362, %298
  %309 = phi i1 [ true, %298 ], [ false, %362 ]
  %310 = phi i64 [ 0, %298 ], [ 1, %362 ]
  %311 = getelementptr inbounds ptr, ptr %304, i64 %310
  %312 = load ptr, ptr %311, align 8
  %313 = load i32, ptr %312, align 8
  %314 = icmp eq i32 %313, 1
  br i1 %314, label %315, label %362

315:                                              ; preds = %308
  %316 = getelementptr inbounds %struct.array, ptr %312, i64 0, i32 10
  %317 = load ptr, ptr %316, align 8
  %318 = icmp eq ptr %317, null
  br i1 %318, label %319, label %362

319:                                              ; preds = %315
  %320 = load i64, ptr %301, align 8
  %321 = getelementptr inbounds %struct.object, ptr %312, i64 0, i32 2
  %322 = load ptr, ptr %321, align 8
  %323 = load ptr, ptr %305, align 8
  %324 = icmp eq ptr %322, %323
  br i1 %324, label %325, label %362

325:                                              ; preds = %319
  %326 = getelementptr inbounds %struct.array, ptr %312, i64 0, i32 2
  %327 = load i32, ptr %326, align 8
  %328 = sext i32 %327 to i64
  %329 = icmp eq i64 %320, %328
  br i1 %329, label %330, label %362

330:                                              ; preds = %325
  %331 = getelementptr inbounds %struct.array, ptr %312, i64 0, i32 7
  %332 = load ptr, ptr %331, align 8
  %333 = load ptr, ptr %306, align 8
  %334 = icmp eq ptr %332, %333
  br i1 %334, label %335, label %362

335:                                              ; preds = %330
  %336 = getelementptr inbounds %struct.array, ptr %312, i64 0, i32 8
  %337 = load i32, ptr %336, align 8
  %338 = and i32 %337, 1285
  %339 = icmp eq i32 %338, 1285
  br i1 %339, label %340, label %362

340:                                              ; preds = %335
  %341 = load ptr, ptr %307, align 8
  %342 = icmp sgt i64 %320, 0
  br i1 %342, label %344, label %343

343:                                              ; preds = %340
  store i32 2, ptr %312, align 8
  br label %393

344:                                              ; preds = %340
  %345 = getelementptr inbounds %struct.array, ptr %312, i64 0, i32 4
  %346 = load ptr, ptr %345, align 8
  %347 = load i64, ptr %346, align 8
  %348 = load i64, ptr %341, align 8
  %349 = icmp eq i64 %347, %348
  br i1 %349, label %350, label %362

350:                                              ; preds = %344, %354
  %351 = phi i64 [ %352, %354 ], [ 0, %344 ]
  %352 = add nuw nsw i64 %351, 1
  %353 = icmp eq i64 %352, %320
  br i1 %353, label %363, label %354, !llvm.loop !7

354:                                              ; preds = %350
  %355 = getelementptr inbounds i64, ptr %346, i64 %352
  %356 = load i64, ptr %355, align 8
  %357 = getelementptr inbounds i64, ptr %341, i64 %352
  %358 = load i64, ptr %357, align 8
  %359 = icmp eq i64 %356, %358
  br i1 %359, label %350, label %360, !llvm.loop !7

360:                                              ; preds = %354
  %361 = icmp slt i64 %352, %320
  br i1 %361, label %362, label %363

362:                                              ; preds = %360, %344, %335, %330, %325, %319, %315, %308
  br i1 %309, label %308, label %364, !llvm.loop !12

363:                                              ; preds = %360, %350
  store i32 2, ptr %312, align 8
  br label %393

364:                                              ; preds = %362
  %365 = getelementptr inbounds %struct.interpreter, ptr %305, i64 0, i32 9
  %366 = load ptr, ptr %365, align 8
  %367 = load ptr, ptr %305, align 8
  %368 = load i64, ptr %301, align 8
  %369 = trunc i64 %368 to i32
  %370 = load ptr, ptr %307, align 8
  %371 = tail call ptr %366(ptr noundef %367, i32 noundef %369, ptr noundef %370, i32 noundef 12, ptr noundef null, ptr noundef null, i32 noundef 0, i32 noundef 0, ptr noundef null) #8
  %372 = icmp eq ptr %371, null
  br i1 %372, label %381, label %373

373:                                              ; preds = %364
  %374 = load i32, ptr %371, align 8
  %375 = add nsw i32 %374, 1
  store i32 %375, ptr %371, align 8
  %376 = load ptr, ptr %304, align 8
  %377 = getelementptr inbounds ptr, ptr %304, i64 1
  %378 = load ptr, ptr %377, align 8
  store ptr %378, ptr %304, align 8
  store ptr %371, ptr %377, align 8
  %379 = getelementptr inbounds %struct.interpreter, ptr %305, i64 0, i32 15
  %380 = load ptr, ptr %379, align 8
  tail call void %380(ptr noundef %376) #8
  br label %393

381:                                              ; preds = %364
  %382 = getelementptr inbounds [4 x ptr], ptr %8, i64 0, i64 %299
  store ptr null, ptr %382, align 8
  %383 = icmp eq i64 %299, 0
  br i1 %383, label %549, label %384

384:                                              ; preds = %381
  %385 = getelementptr inbounds %struct.interpreter, ptr %12, i64 0, i32 15
  br label %386

386:                                              ; preds = %386, %384
  %387 = phi i64 [ 0, %384 ], [ %391, %386 ]
  %388 = load ptr, ptr %385, align 8
  %389 = getelementptr inbounds ptr, ptr %8, i64 %387
  %390 = load ptr, ptr %389, align 8
  tail call void %388(ptr noundef %390) #8
  %391 = add nuw nsw i64 %387, 1
  %392 = icmp eq i64 %391, %299
  br i1 %392, label %549, label %386, !llvm.loop !13

393:                                              ; preds = %363, %373, %343
  %394 = phi ptr [ %312, %343 ], [ %371, %373 ], [ %312, %363 ]
  %395 = getelementptr inbounds [4 x ptr], ptr %8, i64 0, i64 %299
  store ptr %394, ptr %395, align 8
  %396 = add nuw nsw i64 %299, 1
  %397 = load i64, ptr %263, align 8
  %398 = icmp slt i64 %396, %397
  br i1 %398, label %298, label %399, !llvm.loop !14

399:                                              ; preds = %393
  %400 = load ptr, ptr %8, align 16
  %401 = icmp sgt i64 %397, 1
  br i1 %401, label %402, label %428

402:                                              ; preds = %399
  %403 = getelementptr inbounds %struct.interpreter, ptr %12, i64 0, i32 10
  %404 = load ptr, ptr %403, align 8
  %405 = tail call ptr %404(i64 noundef %397) #8
  %406 = icmp eq ptr %405, null
  %407 = load i64, ptr %263, align 8
  %408 = icmp sgt i64 %407, 0
  br i1 %406, label %410, label %409

409:                                              ; preds = %402
  br i1 %408, label %420, label %428

410:                                              ; preds = %402
  br i1 %408, label %411, label %549

411:                                              ; preds = %410
  %412 = getelementptr inbounds %struct.interpreter, ptr %12, i64 0, i32 15
  br label %413

413:                                              ; preds = %413, %411
  %414 = phi i64 [ 0, %411 ], [ %418, %413 ]
  %415 = load ptr, ptr %412, align 8
  %416 = getelementptr inbounds ptr, ptr %8, i64 %414
  %417 = load ptr, ptr %416, align 8
  tail call void %415(ptr noundef %417) #8
  %418 = add nuw nsw i64 %414, 1
  %419 = icmp eq i64 %418, %407
  br i1 %419, label %549, label %413, !llvm.loop !13

420:                                              ; preds = %409, %420
  %421 = phi i64 [ %425, %420 ], [ 0, %409 ]
  %422 = getelementptr inbounds [4 x ptr], ptr %8, i64 0, i64 %421
  %423 = load ptr, ptr %422, align 8
  %424 = getelementptr inbounds %struct.tuple, ptr %405, i64 0, i32 2, i64 %421
  store ptr %423, ptr %424, align 8
  %425 = add nuw nsw i64 %421, 1
  %426 = load i64, ptr %263, align 8
  %427 = icmp slt i64 %425, %426
  br i1 %427, label %420, label %428, !llvm.loop !15

428:                                              ; preds = %420, %293, %409, %399
  %429 = phi ptr [ %400, %399 ], [ %400, %409 ], [ %294, %293 ], [ %400, %420 ]
  %430 = phi ptr [ %400, %399 ], [ %405, %409 ], [ %294, %293 ], [ %405, %420 ]
  %431 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 15
  %432 = load ptr, ptr %431, align 8
  %433 = icmp eq ptr %432, null
  br i1 %433, label %434, label %437

434:                                              ; preds = %428
  %435 = getelementptr inbounds %struct.array, ptr %429, i64 0, i32 1
  %436 = load ptr, ptr %435, align 8
  br label %437

437:                                              ; preds = %428, %434
  %438 = phi ptr [ %436, %434 ], [ %432, %428 ]
  %439 = load i64, ptr %255, align 8
  %440 = add nsw i64 %439, -1
  %441 = getelementptr inbounds [32 x ptr], ptr %6, i64 0, i64 %440
  store ptr %438, ptr %441, align 8
  %442 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 4
  %443 = load ptr, ptr %442, align 8
  call void %443(ptr noundef nonnull %6) #8
  %444 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 14
  %445 = load i64, ptr %444, align 8
  %446 = icmp slt i64 %445, 4
  br i1 %446, label %447, label %460

447:                                              ; preds = %437
  %448 = icmp sgt i64 %445, 0
  br i1 %448, label %449, label %490

449:                                              ; preds = %447, %449
  %450 = phi i8 [ %457, %449 ], [ 1, %447 ]
  %451 = phi i64 [ %458, %449 ], [ 0, %447 ]
  %452 = getelementptr inbounds double, ptr %438, i64 %451
  %453 = load double, ptr %452, align 8
  %454 = call double @llvm.fabs.f64(double %453)
  %455 = fcmp ole double %454, 0x7FEFFFFFFFFFFFFF
  %456 = zext i1 %455 to i8
  %457 = and i8 %450, %456
  %458 = add nuw nsw i64 %451, 1
  %459 = icmp eq i64 %458, %445
  br i1 %459, label %484, label %449, !llvm.loop !8

460:                                              ; preds = %437
  %461 = add nsw i64 %445, -4
  br label %471

462:                                              ; preds = %471
  %463 = extractelement <4 x i64> %482, i64 0
  %464 = extractelement <4 x i64> %482, i64 1
  %465 = and i64 %463, %464
  %466 = extractelement <4 x i64> %482, i64 2
  %467 = and i64 %465, %466
  %468 = extractelement <4 x i64> %482, i64 3
  %469 = and i64 %467, %468
  %470 = icmp eq i64 %469, 0
  br i1 %470, label %486, label %490

471:                                              ; preds = %471, %460
  %472 = phi i64 [ 0, %460 ], [ %474, %471 ]
  %473 = phi <4 x i64> [ <i64 -1, i64 -1, i64 -1, i64 -1>, %460 ], [ %482, %471 ]
  %474 = add nuw nsw i64 %472, 4
  %475 = icmp sgt i64 %474, %445
  %476 = select i1 %475, i64 %461, i64 %472
  %477 = getelementptr inbounds double, ptr %438, i64 %476
  %478 = load <4 x i64>, ptr %477, align 8
  %479 = and <4 x i64> %478, <i64 9223372036854775807, i64 9223372036854775807, i64 9223372036854775807, i64 9223372036854775807>
  %480 = bitcast <4 x i64> %479 to <4 x double>
  %481 = fcmp ole <4 x double> %480, <double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF>
  %482 = select <4 x i1> %481, <4 x i64> %473, <4 x i64> zeroinitializer
  %483 = icmp slt i64 %474, %445
  br i1 %483, label %471, label %462, !llvm.loop !9

484:                                              ; preds = %449
  %485 = icmp eq i8 %457, 0
  br i1 %485, label %486, label %490

486:                                              ; preds = %462, %484
  %487 = getelementptr inbounds %struct.interpreter, ptr %12, i64 0, i32 15
  %488 = load ptr, ptr %487, align 8
  call void %488(ptr noundef %430) #8
  %489 = call fastcc ptr @otherwise(ptr noundef %0, ptr noundef %1, i64 noundef %2, ptr noundef %3)
  br label %549

490:                                              ; preds = %447, %462, %484
  %491 = load ptr, ptr %431, align 8
  %492 = icmp eq ptr %491, null
  br i1 %492, label %549, label %493

493:                                              ; preds = %490
  %494 = load i64, ptr %263, align 8
  %495 = icmp sgt i64 %494, 0
  br i1 %495, label %496, label %498

496:                                              ; preds = %493
  %497 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 13
  br label %502

498:                                              ; preds = %518, %493
  %499 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 11
  %500 = load i64, ptr %499, align 8
  %501 = icmp sgt i64 %500, -1
  br i1 %501, label %537, label %549

502:                                              ; preds = %496, %518
  %503 = phi i64 [ %494, %496 ], [ %519, %518 ]
  %504 = phi i64 [ 0, %496 ], [ %520, %518 ]
  %505 = load ptr, ptr %497, align 8
  %506 = getelementptr inbounds %struct.part, ptr %505, i64 %504, i32 3
  %507 = load i64, ptr %506, align 8
  %508 = icmp sgt i64 %507, 0
  br i1 %508, label %509, label %518

509:                                              ; preds = %502
  %510 = getelementptr inbounds [4 x ptr], ptr %8, i64 0, i64 %504
  %511 = load ptr, ptr %510, align 8
  %512 = getelementptr inbounds %struct.array, ptr %511, i64 0, i32 1
  %513 = getelementptr inbounds %struct.part, ptr %505, i64 %504, i32 4
  %514 = getelementptr inbounds %struct.part, ptr %505, i64 %504, i32 2
  %515 = getelementptr inbounds %struct.part, ptr %505, i64 %504, i32 5
  br label %522

516:                                              ; preds = %522
  %517 = load i64, ptr %263, align 8
  br label %518

518:                                              ; preds = %516, %502
  %519 = phi i64 [ %517, %516 ], [ %503, %502 ]
  %520 = add nuw nsw i64 %504, 1
  %521 = icmp slt i64 %520, %519
  br i1 %521, label %502, label %498, !llvm.loop !16

522:                                              ; preds = %509, %522
  %523 = phi i64 [ 0, %509 ], [ %534, %522 ]
  %524 = load ptr, ptr %512, align 8
  %525 = load i64, ptr %513, align 8
  %526 = mul nsw i64 %525, %523
  %527 = getelementptr inbounds double, ptr %524, i64 %526
  %528 = load i64, ptr %514, align 8
  %529 = getelementptr inbounds double, ptr %438, i64 %528
  %530 = load i64, ptr %515, align 8
  %531 = mul nsw i64 %530, %523
  %532 = getelementptr inbounds double, ptr %529, i64 %531
  %533 = shl nsw i64 %525, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %527, ptr align 8 %532, i64 %533, i1 false)
  %534 = add nuw nsw i64 %523, 1
  %535 = load i64, ptr %506, align 8
  %536 = icmp slt i64 %534, %535
  br i1 %536, label %522, label %516, !llvm.loop !17

537:                                              ; preds = %498
  %538 = getelementptr inbounds %struct.table, ptr %10, i64 0, i32 6
  %539 = load ptr, ptr %538, align 8
  %540 = getelementptr inbounds %struct.argument, ptr %539, i64 %500, i32 2
  %541 = load i64, ptr %540, align 8
  %542 = getelementptr inbounds [32 x ptr], ptr %6, i64 0, i64 %500
  %543 = load ptr, ptr %542, align 8
  %544 = load i64, ptr %444, align 8
  %545 = getelementptr inbounds double, ptr %438, i64 %544
  %546 = sub i64 0, %541
  %547 = getelementptr inbounds double, ptr %545, i64 %546
  %548 = shl nsw i64 %541, 3
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %543, ptr align 8 %547, i64 %548, i1 false)
  br label %549

549:                                              ; preds = %386, %413, %381, %410, %490, %537, %498, %486
  %550 = phi ptr [ %489, %486 ], [ %430, %498 ], [ %430, %537 ], [ %430, %490 ], [ null, %410 ], [ null, %381 ], [ null, %413 ], [ null, %386 ]
  call void @llvm.lifetime.end.p0(i64 32, ptr nonnull %8) #8
  br label %551

551:                                              ; preds = %147, %245, %549, %289
  %552 = phi ptr [ %290, %289 ], [ %550, %549 ], [ %148, %147 ], [ %246, %245 ]
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %6) #8
  br label %553

553:                                              ; preds = %551, %115, %104
  %554 = phi ptr [ %552, %551 ], [ %105, %104 ], [ %116, %115 ]
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %5) #8
  ret ptr %554
}

; Function Attrs: argmemonly mustprogress nocallback nofree nosync nounwind willreturn
declare void @llvm.lifetime.start.p0(i64 immarg, ptr nocapture) #1

; Function Attrs: nounwind
define internal fastcc ptr @otherwise(ptr nocapture noundef readonly %0, ptr noundef %1, i64 noundef %2, ptr noundef %3) unnamed_addr #0 {
  %5 = alloca i64, align 8
  %6 = alloca [128 x i64], align 16
  %7 = alloca [8 x i64], align 16
  %8 = alloca [32 x ptr], align 16
  %9 = alloca [32 x ptr], align 16
  %10 = getelementptr inbounds %struct.array, ptr %0, i64 0, i32 1
  %11 = load ptr, ptr %10, align 8
  %12 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 1
  %13 = load ptr, ptr %12, align 8
  %14 = icmp eq ptr %3, null
  br i1 %14, label %15, label %17

15:                                               ; preds = %4
  %16 = icmp sgt i64 %2, 32
  br i1 %16, label %22, label %28

17:                                               ; preds = %4
  %18 = getelementptr inbounds %struct.tuple, ptr %3, i64 0, i32 1
  %19 = load i64, ptr %18, align 8
  %20 = add nsw i64 %19, %2
  %21 = icmp sgt i64 %20, 32
  br i1 %21, label %22, label %218

22:                                               ; preds = %17, %15
  %23 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 17
  %24 = load ptr, ptr %23, align 8
  %25 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 2
  %26 = load ptr, ptr %25, align 8
  %27 = tail call ptr %24(ptr noundef %26, ptr noundef %1, i64 noundef %2, ptr noundef %3) #8
  br label %347

28:                                               ; preds = %15
  %29 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 18
  %30 = load ptr, ptr %29, align 8
  %31 = icmp eq ptr %30, null
  br i1 %31, label %212, label %32

32:                                               ; preds = %28
  %33 = load ptr, ptr %30, align 8
  %34 = icmp eq ptr %33, null
  br i1 %34, label %212, label %35

35:                                               ; preds = %32
  %36 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 7
  %37 = load i64, ptr %36, align 8
  %38 = icmp eq i64 %37, 0
  br i1 %38, label %39, label %212

39:                                               ; preds = %35
  %40 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 5
  %41 = load i64, ptr %40, align 8
  %42 = icmp eq i64 %41, %2
  br i1 %42, label %43, label %212

43:                                               ; preds = %39
  %44 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 11
  %45 = load i64, ptr %44, align 8
  %46 = icmp sgt i64 %45, -1
  br i1 %46, label %212, label %47

47:                                               ; preds = %43
  %48 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 12
  %49 = load i64, ptr %48, align 8
  %50 = icmp sgt i64 %49, 1
  br i1 %50, label %212, label %51

51:                                               ; preds = %47
  call void @llvm.lifetime.start.p0(i64 1024, ptr nonnull %6) #8
  %52 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 9
  %53 = load i64, ptr %52, align 8
  %54 = shl nsw i64 %53, 5
  call void @llvm.memset.p0.i64(ptr nonnull align 16 %6, i8 0, i64 %54, i1 false)
  %55 = icmp sgt i64 %2, 0
  br i1 %55, label %56, label %209

56:                                               ; preds = %51
  %57 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 6
  %58 = load ptr, ptr %57, align 8
  %59 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 1
  br label %60

60:                                               ; preds = %119, %56
  %61 = phi i1 [ true, %56 ], [ %132, %119 ]
  %62 = phi i64 [ 0, %56 ], [ %120, %119 ]
  %63 = phi i64 [ 0, %56 ], [ %131, %119 ]
  %64 = getelementptr inbounds ptr, ptr %1, i64 %63
  %65 = load ptr, ptr %64, align 8
  %66 = getelementptr inbounds %struct.argument, ptr %58, i64 %63, i32 1
  %67 = load i64, ptr %66, align 8
  %68 = getelementptr inbounds %struct.argument, ptr %58, i64 %63, i32 5
  %69 = load i64, ptr %68, align 8
  %70 = getelementptr inbounds %struct.object, ptr %65, i64 0, i32 2
  %71 = load ptr, ptr %70, align 8
  %72 = load ptr, ptr %13, align 8
  %73 = icmp eq ptr %71, %72
  br i1 %73, label %74, label %209

74:                                               ; preds = %60
  %75 = add nsw i64 %67, 1
  %76 = getelementptr inbounds %struct.array, ptr %65, i64 0, i32 2
  %77 = load i32, ptr %76, align 8
  %78 = sext i32 %77 to i64
  %79 = icmp eq i64 %75, %78
  br i1 %79, label %80, label %209

80:                                               ; preds = %74
  %81 = getelementptr inbounds %struct.array, ptr %65, i64 0, i32 7
  %82 = load ptr, ptr %81, align 8
  %83 = load ptr, ptr %59, align 8
  %84 = icmp eq ptr %82, %83
  br i1 %84, label %85, label %209

85:                                               ; preds = %80
  %86 = getelementptr inbounds %struct.array, ptr %65, i64 0, i32 8
  %87 = load i32, ptr %86, align 8
  %88 = sext i32 %87 to i64
  %89 = and i64 %69, %88
  %90 = icmp eq i64 %89, %69
  br i1 %90, label %91, label %209

91:                                               ; preds = %85
  %92 = getelementptr inbounds %struct.argument, ptr %58, i64 %63, i32 3
  %93 = load ptr, ptr %92, align 8
  %94 = icmp sgt i64 %67, 0
  %95 = getelementptr inbounds %struct.array, ptr %65, i64 0, i32 4
  %96 = load ptr, ptr %95, align 8
  br i1 %94, label %97, label %114

97:                                               ; preds = %91
  %98 = getelementptr inbounds i64, ptr %96, i64 1
  %99 = load i64, ptr %98, align 8
  %100 = load i64, ptr %93, align 8
  %101 = icmp eq i64 %99, %100
  br i1 %101, label %102, label %134

102:                                              ; preds = %97, %105
  %103 = phi i64 [ %106, %105 ], [ 1, %97 ]
  %104 = icmp eq i64 %103, %67
  br i1 %104, label %114, label %105, !llvm.loop !7

105:                                              ; preds = %102
  %106 = add nuw nsw i64 %103, 1
  %107 = getelementptr inbounds i64, ptr %96, i64 %106
  %108 = load i64, ptr %107, align 8
  %109 = getelementptr inbounds i64, ptr %93, i64 %103
  %110 = load i64, ptr %109, align 8
  %111 = icmp eq i64 %108, %110
  br i1 %111, label %102, label %112, !llvm.loop !7

112:                                              ; preds = %105
  %113 = icmp slt i64 %103, %67
  br i1 %113, label %134, label %114

114:                                              ; preds = %102, %91, %112
  %115 = icmp eq i64 %63, 0
  %116 = load i64, ptr %96, align 8
  br i1 %115, label %119, label %117

117:                                              ; preds = %114
  %118 = icmp eq i64 %116, %62
  br i1 %118, label %119, label %134

119:                                              ; preds = %117, %114
  %120 = phi i64 [ %62, %117 ], [ %116, %114 ]
  %121 = getelementptr inbounds %struct.array, ptr %65, i64 0, i32 1
  %122 = load ptr, ptr %121, align 8
  %123 = ptrtoint ptr %122 to i64
  %124 = shl nsw i64 %63, 2
  %125 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %124
  store i64 %123, ptr %125, align 16
  %126 = getelementptr inbounds %struct.argument, ptr %58, i64 %63, i32 2
  %127 = load i64, ptr %126, align 8
  %128 = shl nsw i64 %127, 3
  %129 = or i64 %124, 1
  %130 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %129
  store i64 %128, ptr %130, align 8
  %131 = add nuw nsw i64 %63, 1
  %132 = icmp slt i64 %131, %2
  %133 = icmp eq i64 %131, %2
  br i1 %133, label %134, label %60, !llvm.loop !18

134:                                              ; preds = %119, %117, %112, %97
  %135 = phi i64 [ %120, %119 ], [ %62, %117 ], [ %62, %97 ], [ %62, %112 ]
  %136 = phi i1 [ %132, %119 ], [ %61, %117 ], [ %61, %97 ], [ %61, %112 ]
  %137 = icmp slt i64 %135, 1
  %138 = select i1 %136, i1 true, i1 %137
  br i1 %138, label %209, label %139

139:                                              ; preds = %134
  %140 = getelementptr inbounds %struct.lanes, ptr %30, i64 0, i32 2
  %141 = load i64, ptr %140, align 8
  %142 = icmp sgt i64 %135, %141
  br i1 %142, label %209, label %143

143:                                              ; preds = %139
  %144 = add nsw i64 %53, -1
  %145 = icmp sgt i64 %144, %2
  br i1 %145, label %146, label %149

146:                                              ; preds = %143
  %147 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 10
  %148 = load ptr, ptr %147, align 8
  br label %151

149:                                              ; preds = %151, %143
  call void @llvm.lifetime.start.p0(i64 64, ptr nonnull %7) #8
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 16 dereferenceable(64) %7, i8 0, i64 64, i1 false)
  store i64 %135, ptr %7, align 16
  %150 = icmp eq i64 %49, 0
  br i1 %150, label %167, label %160

151:                                              ; preds = %151, %146
  %152 = phi i64 [ %2, %146 ], [ %158, %151 ]
  %153 = getelementptr inbounds ptr, ptr %148, i64 %152
  %154 = load ptr, ptr %153, align 8
  %155 = ptrtoint ptr %154 to i64
  %156 = shl nsw i64 %152, 2
  %157 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %156
  store i64 %155, ptr %157, align 16
  %158 = add nsw i64 %152, 1
  %159 = icmp eq i64 %158, %144
  br i1 %159, label %149, label %151, !llvm.loop !19

160:                                              ; preds = %149
  %161 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 13
  %162 = load ptr, ptr %161, align 8
  %163 = load i64, ptr %162, align 8
  %164 = icmp sgt i64 %163, 0
  br i1 %164, label %165, label %167

165:                                              ; preds = %160
  %166 = getelementptr inbounds %struct.part, ptr %162, i64 0, i32 1
  br label %177

167:                                              ; preds = %177, %160, %149
  %168 = phi i64 [ %163, %160 ], [ 0, %149 ], [ %163, %177 ]
  %169 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 9
  %170 = load ptr, ptr %169, align 8
  %171 = load ptr, ptr %13, align 8
  %172 = trunc i64 %168 to i32
  %173 = add nsw i32 %172, 1
  %174 = call ptr %170(ptr noundef %171, i32 noundef %173, ptr noundef nonnull %7, i32 noundef 12, ptr noundef null, ptr noundef null, i32 noundef 0, i32 noundef 0, ptr noundef null) #8
  %175 = icmp eq ptr %174, null
  %176 = zext i1 %175 to i8
  br i1 %175, label %207, label %185

177:                                              ; preds = %177, %165
  %178 = phi i64 [ 0, %165 ], [ %182, %177 ]
  %179 = load ptr, ptr %166, align 8
  %180 = getelementptr inbounds i64, ptr %179, i64 %178
  %181 = load i64, ptr %180, align 8
  %182 = add nuw nsw i64 %178, 1
  %183 = getelementptr inbounds [8 x i64], ptr %7, i64 0, i64 %182
  store i64 %181, ptr %183, align 8
  %184 = icmp eq i64 %182, %163
  br i1 %184, label %167, label %177, !llvm.loop !20

185:                                              ; preds = %167
  %186 = getelementptr inbounds %struct.array, ptr %174, i64 0, i32 1
  %187 = load ptr, ptr %186, align 8
  %188 = ptrtoint ptr %187 to i64
  %189 = load i64, ptr %52, align 8
  %190 = shl i64 %189, 2
  %191 = add i64 %190, -4
  %192 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %191
  store i64 %188, ptr %192, align 16
  %193 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 14
  %194 = load i64, ptr %193, align 8
  %195 = shl nsw i64 %194, 3
  %196 = add i64 %190, -3
  %197 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %196
  store i64 %195, ptr %197, align 8
  %198 = load ptr, ptr %29, align 8
  %199 = getelementptr inbounds %struct.lanes, ptr %198, i64 0, i32 1
  %200 = load ptr, ptr %199, align 8
  %201 = load ptr, ptr %198, align 8
  %202 = call i64 %200(ptr noundef %201, ptr noundef nonnull %6, i64 noundef %189, i64 noundef 0, ptr noundef null, ptr noundef null, i64 noundef 0, i64 noundef %135, i64 noundef 1) #8
  %203 = icmp eq i64 %202, 0
  br i1 %203, label %207, label %204

204:                                              ; preds = %185
  %205 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 15
  %206 = load ptr, ptr %205, align 8
  call void %206(ptr noundef nonnull %174) #8
  br label %207

207:                                              ; preds = %204, %185, %167
  %208 = phi ptr [ null, %204 ], [ null, %167 ], [ %174, %185 ]
  call void @llvm.lifetime.end.p0(i64 64, ptr nonnull %7) #8
  br label %209

209:                                              ; preds = %85, %80, %74, %60, %207, %139, %134, %51
  %210 = phi i8 [ 0, %134 ], [ 0, %139 ], [ %176, %207 ], [ 0, %51 ], [ 0, %60 ], [ 0, %74 ], [ 0, %80 ], [ 0, %85 ]
  %211 = phi ptr [ null, %134 ], [ null, %139 ], [ %208, %207 ], [ null, %51 ], [ null, %60 ], [ null, %74 ], [ null, %80 ], [ null, %85 ]
  call void @llvm.lifetime.end.p0(i64 1024, ptr nonnull %6) #8
  br label %212

212:                                              ; preds = %28, %32, %35, %39, %43, %47, %209
  %213 = phi i8 [ 0, %28 ], [ 0, %32 ], [ 0, %43 ], [ 0, %47 ], [ %210, %209 ], [ 0, %39 ], [ 0, %35 ]
  %214 = phi ptr [ null, %28 ], [ null, %32 ], [ null, %43 ], [ null, %47 ], [ %211, %209 ], [ null, %39 ], [ null, %35 ]
  %215 = icmp eq ptr %214, null
  %216 = icmp eq i8 %213, 0
  %217 = select i1 %215, i1 %216, i1 false
  br i1 %217, label %218, label %347

218:                                              ; preds = %17, %212
  %219 = phi i64 [ %2, %212 ], [ %20, %17 ]
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %8) #8
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %9) #8
  %220 = icmp sgt i64 %219, 0
  br i1 %220, label %221, label %325

221:                                              ; preds = %218
  %222 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 5
  %223 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 6
  %224 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 9
  %225 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 2
  %226 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 4
  %227 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 3
  %228 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 12
  %229 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 13
  %230 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 14
  %231 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 15
  br label %235

232:                                              ; preds = %314
  %233 = icmp ne i64 %316, 0
  %234 = select i1 %320, i1 %233, i1 false
  br i1 %234, label %322, label %324

235:                                              ; preds = %221, %314
  %236 = phi i64 [ 0, %221 ], [ %317, %314 ]
  %237 = phi i64 [ 0, %221 ], [ %316, %314 ]
  %238 = phi i8 [ 0, %221 ], [ %315, %314 ]
  %239 = getelementptr inbounds ptr, ptr %1, i64 %236
  %240 = load ptr, ptr %239, align 8
  %241 = getelementptr inbounds [32 x ptr], ptr %8, i64 0, i64 %236
  store ptr %240, ptr %241, align 8
  %242 = icmp slt i64 %236, %2
  br i1 %242, label %243, label %314

243:                                              ; preds = %235
  %244 = getelementptr inbounds %struct.object, ptr %240, i64 0, i32 2
  %245 = load ptr, ptr %244, align 8
  %246 = load ptr, ptr %222, align 8
  %247 = icmp eq ptr %245, %246
  br i1 %247, label %251, label %248

248:                                              ; preds = %243
  %249 = load ptr, ptr %223, align 8
  %250 = icmp eq ptr %245, %249
  br i1 %250, label %251, label %314

251:                                              ; preds = %248, %243
  call void @llvm.lifetime.start.p0(i64 8, ptr nonnull %5) #8
  %252 = getelementptr inbounds %struct.list, ptr %240, i64 0, i32 1
  %253 = load i64, ptr %252, align 8
  store i64 %253, ptr %5, align 8
  %254 = load ptr, ptr %224, align 8
  %255 = load ptr, ptr %13, align 8
  %256 = call ptr %254(ptr noundef %255, i32 noundef 1, ptr noundef nonnull %5, i32 noundef 12, ptr noundef null, ptr noundef null, i32 noundef 0, i32 noundef 0, ptr noundef null) #8
  %257 = icmp eq ptr %256, null
  %258 = zext i1 %257 to i8
  br i1 %257, label %310, label %259

259:                                              ; preds = %251
  br i1 %247, label %260, label %263

260:                                              ; preds = %259
  %261 = getelementptr inbounds %struct.list, ptr %240, i64 0, i32 2
  %262 = load ptr, ptr %261, align 8
  br label %265

263:                                              ; preds = %259
  %264 = getelementptr inbounds %struct.tuple, ptr %240, i64 0, i32 2
  br label %265

265:                                              ; preds = %263, %260
  %266 = phi ptr [ %262, %260 ], [ %264, %263 ]
  %267 = load i64, ptr %252, align 8
  %268 = load i64, ptr %5, align 8
  %269 = icmp eq i64 %267, %268
  %270 = icmp sgt i64 %268, 0
  %271 = and i1 %269, %270
  br i1 %271, label %272, label %274

272:                                              ; preds = %265
  %273 = getelementptr inbounds %struct.array, ptr %256, i64 0, i32 1
  br label %275

274:                                              ; preds = %265
  br i1 %269, label %311, label %308

275:                                              ; preds = %304, %272
  %276 = phi i64 [ 0, %272 ], [ %305, %304 ]
  %277 = load ptr, ptr %273, align 8
  %278 = getelementptr inbounds double, ptr %277, i64 %276
  %279 = getelementptr inbounds ptr, ptr %266, i64 %276
  %280 = load ptr, ptr %279, align 8
  %281 = getelementptr inbounds %struct.object, ptr %280, i64 0, i32 2
  %282 = load ptr, ptr %281, align 8
  %283 = load ptr, ptr %225, align 8
  %284 = icmp eq ptr %282, %283
  br i1 %284, label %288, label %285

285:                                              ; preds = %275
  %286 = load ptr, ptr %226, align 8
  %287 = icmp eq ptr %282, %286
  br i1 %287, label %288, label %291

288:                                              ; preds = %285, %275
  %289 = getelementptr inbounds %struct.real, ptr %280, i64 0, i32 1
  %290 = load double, ptr %289, align 8
  store double %290, ptr %278, align 8
  br label %304

291:                                              ; preds = %285
  %292 = load ptr, ptr %227, align 8
  %293 = icmp eq ptr %282, %292
  br i1 %293, label %294, label %308

294:                                              ; preds = %291
  %295 = load ptr, ptr %228, align 8
  %296 = call double %295(ptr noundef nonnull %280) #8
  store double %296, ptr %278, align 8
  %297 = fcmp oeq double %296, -1.000000e+00
  br i1 %297, label %298, label %304

298:                                              ; preds = %294
  %299 = load ptr, ptr %229, align 8
  %300 = call ptr %299() #8
  %301 = icmp eq ptr %300, null
  br i1 %301, label %304, label %302

302:                                              ; preds = %298
  %303 = load ptr, ptr %230, align 8
  call void %303() #8
  br label %308

304:                                              ; preds = %298, %294, %288
  %305 = add nuw nsw i64 %276, 1
  %306 = load i64, ptr %5, align 8
  %307 = icmp slt i64 %305, %306
  br i1 %307, label %275, label %311, !llvm.loop !21

308:                                              ; preds = %291, %302, %274
  %309 = load ptr, ptr %231, align 8
  call void %309(ptr noundef nonnull %256) #8
  br label %310

310:                                              ; preds = %251, %308
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %5) #8
  br label %314

311:                                              ; preds = %304, %274
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %5) #8
  %312 = add nsw i64 %237, 1
  %313 = getelementptr inbounds [32 x ptr], ptr %9, i64 0, i64 %237
  store ptr %256, ptr %313, align 8
  store ptr %256, ptr %241, align 8
  br label %314

314:                                              ; preds = %248, %235, %310, %311
  %315 = phi i8 [ %258, %311 ], [ %258, %310 ], [ %238, %235 ], [ %238, %248 ]
  %316 = phi i64 [ %312, %311 ], [ %237, %310 ], [ %237, %235 ], [ %237, %248 ]
  %317 = add nuw nsw i64 %236, 1
  %318 = icmp slt i64 %317, %219
  %319 = and i8 %315, 1
  %320 = icmp eq i8 %319, 0
  %321 = select i1 %318, i1 %320, i1 false
  br i1 %321, label %235, label %232, !llvm.loop !22

322:                                              ; preds = %232
  %323 = call ptr @entry(ptr noundef %0, ptr noundef nonnull %8, i64 noundef %2, ptr noundef %3)
  br label %333

324:                                              ; preds = %232
  br i1 %320, label %325, label %333

325:                                              ; preds = %218, %324
  %326 = phi i64 [ %316, %324 ], [ 0, %218 ]
  %327 = load ptr, ptr %12, align 8
  %328 = getelementptr inbounds %struct.interpreter, ptr %327, i64 0, i32 17
  %329 = load ptr, ptr %328, align 8
  %330 = getelementptr inbounds %struct.table, ptr %11, i64 0, i32 2
  %331 = load ptr, ptr %330, align 8
  %332 = call ptr %329(ptr noundef %331, ptr noundef %1, i64 noundef %2, ptr noundef %3) #8
  br label %333

333:                                              ; preds = %324, %325, %322
  %334 = phi i64 [ %316, %322 ], [ %316, %324 ], [ %326, %325 ]
  %335 = phi ptr [ %323, %322 ], [ null, %324 ], [ %332, %325 ]
  %336 = icmp sgt i64 %334, 0
  br i1 %336, label %337, label %346

337:                                              ; preds = %333
  %338 = getelementptr inbounds %struct.interpreter, ptr %13, i64 0, i32 15
  br label %339

339:                                              ; preds = %339, %337
  %340 = phi i64 [ 0, %337 ], [ %344, %339 ]
  %341 = load ptr, ptr %338, align 8
  %342 = getelementptr inbounds ptr, ptr %9, i64 %340
  %343 = load ptr, ptr %342, align 8
  call void %341(ptr noundef %343) #8
  %344 = add nuw nsw i64 %340, 1
  %345 = icmp eq i64 %344, %334
  br i1 %345, label %346, label %339, !llvm.loop !13

346:                                              ; preds = %339, %333
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %9) #8
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %8) #8
  br label %347

347:                                              ; preds = %346, %212, %22
  %348 = phi ptr [ %27, %22 ], [ %335, %346 ], [ %214, %212 ]
  ret ptr %348
}

; Function Attrs: argmemonly mustprogress nocallback nofree nosync nounwind willreturn
declare void @llvm.lifetime.end.p0(i64 immarg, ptr nocapture) #1

; Function Attrs: argmemonly mustprogress nocallback nofree nounwind willreturn writeonly
declare void @llvm.memset.p0.i64(ptr nocapture writeonly, i8, i64, i1 immarg) #2

; Function Attrs: argmemonly mustprogress nocallback nofree nounwind willreturn
declare void @llvm.memcpy.p0.p0.i64(ptr noalias nocapture writeonly, ptr noalias nocapture readonly, i64, i1 immarg) #3

; Function Attrs: nounwind
define dso_local ptr @bound(ptr nocapture noundef readonly %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = getelementptr inbounds %struct.array, ptr %0, i64 0, i32 1
  %5 = load ptr, ptr %4, align 8
  %6 = icmp eq i64 %2, 0
  br i1 %6, label %7, label %70

7:                                                ; preds = %3
  %8 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 5
  %9 = load i64, ptr %8, align 8
  %10 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 10
  %11 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 6
  %12 = tail call i64 @llvm.smax.i64(i64 %9, i64 0)
  %13 = icmp slt i64 %9, 1
  br i1 %13, label %78, label %14

14:                                               ; preds = %7
  %15 = load ptr, ptr %10, align 8
  %16 = load ptr, ptr %11, align 8
  br label %17

17:                                               ; preds = %14, %54
  %18 = phi i64 [ %55, %54 ], [ 0, %14 ]
  %19 = getelementptr inbounds ptr, ptr %15, i64 %18
  %20 = load ptr, ptr %19, align 8
  %21 = getelementptr inbounds %struct.argument, ptr %16, i64 %18, i32 2
  %22 = load i64, ptr %21, align 8
  %23 = getelementptr inbounds %struct.argument, ptr %16, i64 %18, i32 4
  %24 = load double, ptr %23, align 8
  %25 = icmp slt i64 %22, 4
  br i1 %25, label %26, label %41

26:                                               ; preds = %17
  %27 = icmp sgt i64 %22, 0
  br i1 %27, label %30, label %54

28:                                               ; preds = %30
  %29 = icmp eq i8 %38, 0
  br i1 %29, label %70, label %54

30:                                               ; preds = %26, %30
  %31 = phi i8 [ %38, %30 ], [ 1, %26 ]
  %32 = phi i64 [ %39, %30 ], [ 0, %26 ]
  %33 = getelementptr inbounds double, ptr %20, i64 %32
  %34 = load double, ptr %33, align 8
  %35 = tail call double @llvm.fabs.f64(double %34)
  %36 = fcmp ole double %35, %24
  %37 = zext i1 %36 to i8
  %38 = and i8 %31, %37
  %39 = add nuw nsw i64 %32, 1
  %40 = icmp eq i64 %39, %22
  br i1 %40, label %28, label %30, !llvm.loop !8

41:                                               ; preds = %17
  %42 = insertelement <4 x double> undef, double %24, i64 0
  %43 = shufflevector <4 x double> %42, <4 x double> poison, <4 x i32> zeroinitializer
  %44 = add nsw i64 %22, -4
  br label %57

45:                                               ; preds = %57
  %46 = extractelement <4 x i64> %68, i64 0
  %47 = extractelement <4 x i64> %68, i64 1
  %48 = and i64 %46, %47
  %49 = extractelement <4 x i64> %68, i64 2
  %50 = and i64 %48, %49
  %51 = extractelement <4 x i64> %68, i64 3
  %52 = and i64 %50, %51
  %53 = icmp eq i64 %52, 0
  br i1 %53, label %70, label %54

54:                                               ; preds = %26, %45, %28
  %55 = add nuw i64 %18, 1
  %56 = icmp eq i64 %55, %12
  br i1 %56, label %78, label %17, !llvm.loop !23

57:                                               ; preds = %57, %41
  %58 = phi i64 [ 0, %41 ], [ %60, %57 ]
  %59 = phi <4 x i64> [ <i64 -1, i64 -1, i64 -1, i64 -1>, %41 ], [ %68, %57 ]
  %60 = add nuw nsw i64 %58, 4
  %61 = icmp sgt i64 %60, %22
  %62 = select i1 %61, i64 %44, i64 %58
  %63 = getelementptr inbounds double, ptr %20, i64 %62
  %64 = load <4 x i64>, ptr %63, align 8
  %65 = and <4 x i64> %64, <i64 9223372036854775807, i64 9223372036854775807, i64 9223372036854775807, i64 9223372036854775807>
  %66 = bitcast <4 x i64> %65 to <4 x double>
  %67 = fcmp oge <4 x double> %43, %66
  %68 = select <4 x i1> %67, <4 x i64> %59, <4 x i64> zeroinitializer
  %69 = icmp slt i64 %60, %22
  br i1 %69, label %57, label %45, !llvm.loop !9

70:                                               ; preds = %45, %28, %3
  %71 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 1
  %72 = load ptr, ptr %71, align 8
  %73 = getelementptr inbounds %struct.interpreter, ptr %72, i64 0, i32 17
  %74 = load ptr, ptr %73, align 8
  %75 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 2
  %76 = load ptr, ptr %75, align 8
  %77 = tail call ptr %74(ptr noundef %76, ptr noundef %1, i64 noundef %2, ptr noundef null) #8
  br label %155

78:                                               ; preds = %54, %7
  %79 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 4
  %80 = load ptr, ptr %79, align 8
  %81 = load ptr, ptr %10, align 8
  tail call void %80(ptr noundef %81) #8
  %82 = load ptr, ptr %10, align 8
  %83 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 9
  %84 = load i64, ptr %83, align 8
  %85 = add nsw i64 %84, -1
  %86 = getelementptr inbounds ptr, ptr %82, i64 %85
  %87 = load ptr, ptr %86, align 8
  %88 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 14
  %89 = load i64, ptr %88, align 8
  %90 = icmp slt i64 %89, 4
  br i1 %90, label %91, label %104

91:                                               ; preds = %78
  %92 = icmp sgt i64 %89, 0
  br i1 %92, label %93, label %138

93:                                               ; preds = %91, %93
  %94 = phi i8 [ %101, %93 ], [ 1, %91 ]
  %95 = phi i64 [ %102, %93 ], [ 0, %91 ]
  %96 = getelementptr inbounds double, ptr %87, i64 %95
  %97 = load double, ptr %96, align 8
  %98 = tail call double @llvm.fabs.f64(double %97)
  %99 = fcmp ole double %98, 0x7FEFFFFFFFFFFFFF
  %100 = zext i1 %99 to i8
  %101 = and i8 %94, %100
  %102 = add nuw nsw i64 %95, 1
  %103 = icmp eq i64 %102, %89
  br i1 %103, label %128, label %93, !llvm.loop !8

104:                                              ; preds = %78
  %105 = add nsw i64 %89, -4
  br label %115

106:                                              ; preds = %115
  %107 = extractelement <4 x i64> %126, i64 0
  %108 = extractelement <4 x i64> %126, i64 1
  %109 = and i64 %107, %108
  %110 = extractelement <4 x i64> %126, i64 2
  %111 = and i64 %109, %110
  %112 = extractelement <4 x i64> %126, i64 3
  %113 = and i64 %111, %112
  %114 = icmp eq i64 %113, 0
  br i1 %114, label %130, label %138

115:                                              ; preds = %115, %104
  %116 = phi i64 [ 0, %104 ], [ %118, %115 ]
  %117 = phi <4 x i64> [ <i64 -1, i64 -1, i64 -1, i64 -1>, %104 ], [ %126, %115 ]
  %118 = add nuw nsw i64 %116, 4
  %119 = icmp sgt i64 %118, %89
  %120 = select i1 %119, i64 %105, i64 %116
  %121 = getelementptr inbounds double, ptr %87, i64 %120
  %122 = load <4 x i64>, ptr %121, align 8
  %123 = and <4 x i64> %122, <i64 9223372036854775807, i64 9223372036854775807, i64 9223372036854775807, i64 9223372036854775807>
  %124 = bitcast <4 x i64> %123 to <4 x double>
  %125 = fcmp ole <4 x double> %124, <double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF>
  %126 = select <4 x i1> %125, <4 x i64> %117, <4 x i64> zeroinitializer
  %127 = icmp slt i64 %118, %89
  br i1 %127, label %115, label %106, !llvm.loop !9

128:                                              ; preds = %93
  %129 = icmp eq i8 %101, 0
  br i1 %129, label %130, label %138

130:                                              ; preds = %106, %128
  %131 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 1
  %132 = load ptr, ptr %131, align 8
  %133 = getelementptr inbounds %struct.interpreter, ptr %132, i64 0, i32 17
  %134 = load ptr, ptr %133, align 8
  %135 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 2
  %136 = load ptr, ptr %135, align 8
  %137 = tail call ptr %134(ptr noundef %136, ptr noundef %1, i64 noundef 0, ptr noundef null) #8
  br label %155

138:                                              ; preds = %91, %106, %128
  %139 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 12
  %140 = load i64, ptr %139, align 8
  %141 = icmp eq i64 %140, 0
  br i1 %141, label %142, label %149

142:                                              ; preds = %138
  %143 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 1
  %144 = load ptr, ptr %143, align 8
  %145 = getelementptr inbounds %struct.interpreter, ptr %144, i64 0, i32 11
  %146 = load ptr, ptr %145, align 8
  %147 = load double, ptr %87, align 8
  %148 = tail call ptr %146(double noundef %147) #8
  br label %155

149:                                              ; preds = %138
  %150 = getelementptr inbounds %struct.table, ptr %5, i64 0, i32 17
  %151 = load ptr, ptr %150, align 8
  %152 = load i32, ptr %151, align 8
  %153 = add nsw i32 %152, 1
  store i32 %153, ptr %151, align 8
  %154 = load ptr, ptr %150, align 8
  br label %155

155:                                              ; preds = %130, %142, %149, %70
  %156 = phi ptr [ %77, %70 ], [ %148, %142 ], [ %154, %149 ], [ %137, %130 ]
  ret ptr %156
}

; Function Attrs: nounwind
define dso_local ptr @choose(ptr nocapture noundef readonly %0, ptr noundef %1, i64 noundef %2, ptr noundef %3) local_unnamed_addr #0 {
  %5 = getelementptr inbounds %struct.array, ptr %0, i64 0, i32 1
  %6 = load ptr, ptr %5, align 8
  %7 = getelementptr inbounds %struct.table, ptr %6, i64 0, i32 1
  %8 = load ptr, ptr %7, align 8
  %9 = icmp sgt i64 %2, 0
  br i1 %9, label %10, label %38

10:                                               ; preds = %4
  %11 = load ptr, ptr %1, align 8
  %12 = getelementptr inbounds %struct.object, ptr %11, i64 0, i32 2
  %13 = load ptr, ptr %12, align 8
  %14 = getelementptr inbounds %struct.interpreter, ptr %8, i64 0, i32 7
  %15 = load ptr, ptr %14, align 8
  %16 = icmp eq ptr %13, %15
  br i1 %16, label %21, label %17

17:                                               ; preds = %10
  %18 = getelementptr inbounds %struct.interpreter, ptr %8, i64 0, i32 6
  %19 = load ptr, ptr %18, align 8
  %20 = icmp eq ptr %13, %19
  br i1 %20, label %21, label %38

21:                                               ; preds = %17, %10
  %22 = getelementptr inbounds %struct.interpreter, ptr %8, i64 0, i32 16
  %23 = load ptr, ptr %22, align 8
  %24 = getelementptr inbounds %struct.table, ptr %6, i64 0, i32 3
  %25 = load ptr, ptr %24, align 8
  %26 = tail call ptr %23(ptr noundef %25, ptr noundef nonnull %11) #8
  %27 = icmp eq ptr %26, null
  br i1 %27, label %28, label %32

28:                                               ; preds = %21
  %29 = getelementptr inbounds %struct.interpreter, ptr %8, i64 0, i32 14
  %30 = load ptr, ptr %29, align 8
  tail call void %30() #8
  %31 = load ptr, ptr %7, align 8
  br label %38

32:                                               ; preds = %21
  %33 = getelementptr inbounds %struct.interpreter, ptr %8, i64 0, i32 17
  %34 = load ptr, ptr %33, align 8
  %35 = getelementptr inbounds ptr, ptr %1, i64 1
  %36 = add nsw i64 %2, -1
  %37 = tail call ptr %34(ptr noundef nonnull %26, ptr noundef nonnull %35, i64 noundef %36, ptr noundef %3) #8
  br label %45

38:                                               ; preds = %28, %17, %4
  %39 = phi ptr [ %31, %28 ], [ %8, %17 ], [ %8, %4 ]
  %40 = getelementptr inbounds %struct.interpreter, ptr %39, i64 0, i32 17
  %41 = load ptr, ptr %40, align 8
  %42 = getelementptr inbounds %struct.table, ptr %6, i64 0, i32 2
  %43 = load ptr, ptr %42, align 8
  %44 = tail call ptr %41(ptr noundef %43, ptr noundef %1, i64 noundef %2, ptr noundef %3) #8
  br label %45

45:                                               ; preds = %32, %38
  %46 = phi ptr [ %44, %38 ], [ %37, %32 ]
  ret ptr %46
}

; Function Attrs: nounwind
define dso_local ptr @refer(ptr nocapture noundef readonly %0, ptr noundef %1, i64 noundef %2, ptr nocapture noundef readnone %3) local_unnamed_addr #0 {
  %5 = getelementptr inbounds %struct.array, ptr %0, i64 0, i32 1
  %6 = load ptr, ptr %5, align 8
  %7 = getelementptr inbounds %struct.table, ptr %6, i64 0, i32 1
  %8 = load ptr, ptr %7, align 8
  %9 = getelementptr inbounds %struct.interpreter, ptr %8, i64 0, i32 17
  %10 = load ptr, ptr %9, align 8
  %11 = getelementptr inbounds %struct.table, ptr %6, i64 0, i32 2
  %12 = load ptr, ptr %11, align 8
  %13 = tail call ptr %10(ptr noundef %12, ptr noundef %1, i64 noundef %2, ptr noundef null) #8
  ret ptr %13
}

; Function Attrs: nounwind
define dso_local ptr @unmade(ptr nocapture noundef readonly %0, ptr noundef %1, i64 noundef %2, ptr noundef %3) local_unnamed_addr #0 {
  %5 = alloca ptr, align 8
  store ptr %3, ptr %5, align 8
  %6 = getelementptr inbounds %struct.array, ptr %0, i64 0, i32 1
  %7 = load ptr, ptr %6, align 8
  %8 = getelementptr inbounds %struct.table, ptr %7, i64 0, i32 1
  %9 = load ptr, ptr %8, align 8
  %10 = getelementptr inbounds %struct.interpreter, ptr %9, i64 0, i32 17
  %11 = load ptr, ptr %10, align 8
  %12 = getelementptr inbounds %struct.table, ptr %7, i64 0, i32 2
  %13 = load ptr, ptr %12, align 8
  %14 = call ptr %11(ptr noundef %13, ptr noundef nonnull %5, i64 noundef 1, ptr noundef null) #8
  %15 = icmp eq ptr %14, null
  br i1 %15, label %25, label %16

16:                                               ; preds = %4
  %17 = getelementptr inbounds %struct.array, ptr %14, i64 0, i32 1
  %18 = load ptr, ptr %17, align 8
  %19 = load ptr, ptr %18, align 8
  %20 = load ptr, ptr %5, align 8
  %21 = call ptr %19(ptr noundef nonnull %14, ptr noundef %1, i64 noundef %2, ptr noundef %20) #8
  %22 = load ptr, ptr %8, align 8
  %23 = getelementptr inbounds %struct.interpreter, ptr %22, i64 0, i32 15
  %24 = load ptr, ptr %23, align 8
  call void %24(ptr noundef nonnull %14) #8
  br label %25

25:                                               ; preds = %4, %16
  %26 = phi ptr [ %21, %16 ], [ null, %4 ]
  ret ptr %26
}

; Function Attrs: mustprogress nofree norecurse nosync nounwind willreturn writeonly
define dso_local void @refuse_by(ptr noundef %0) local_unnamed_addr #4 {
  store ptr %0, ptr @refusal, align 8
  ret void
}

; Function Attrs: nounwind
define dso_local ptr @method_00(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 0, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: noinline nounwind
define internal fastcc ptr @method(i64 noundef %0, ptr noundef %1, ptr noundef %2, i64 noundef %3) unnamed_addr #5 {
  %5 = getelementptr inbounds %struct.object, ptr %1, i64 1
  %6 = load ptr, ptr %5, align 8
  %7 = icmp eq ptr %6, null
  br i1 %7, label %12, label %8

8:                                                ; preds = %4
  %9 = getelementptr inbounds %struct.array, ptr %6, i64 0, i32 1
  %10 = load ptr, ptr %9, align 8
  %11 = getelementptr inbounds ptr, ptr %10, i64 %0
  br label %12

12:                                               ; preds = %4, %8
  %13 = phi ptr [ %11, %8 ], [ @refusal, %4 ]
  %14 = load ptr, ptr %13, align 8
  %15 = getelementptr inbounds %struct.array, ptr %14, i64 0, i32 1
  %16 = load ptr, ptr %15, align 8
  %17 = load ptr, ptr %16, align 8
  %18 = tail call ptr %17(ptr noundef %14, ptr noundef %2, i64 noundef %3, ptr noundef nonnull %1) #8
  ret ptr %18
}

; Function Attrs: nounwind
define dso_local ptr @method_01(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 1, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_02(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 2, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_03(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 3, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_04(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 4, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_05(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 5, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_06(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 6, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_07(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 7, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_10(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 8, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_11(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 9, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_12(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 10, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_13(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 11, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_14(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 12, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_15(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 13, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_16(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 14, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_17(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 15, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_20(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 16, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_21(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 17, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_22(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 18, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_23(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 19, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_24(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 20, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_25(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 21, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_26(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 22, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_27(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 23, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_30(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 24, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_31(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 25, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_32(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 26, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_33(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 27, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_34(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 28, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_35(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 29, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_36(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 30, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_37(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 31, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_40(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 32, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_41(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 33, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_42(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 34, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_43(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 35, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_44(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 36, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_45(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 37, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_46(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 38, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_47(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 39, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_50(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 40, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_51(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 41, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_52(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 42, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_53(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 43, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_54(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 44, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_55(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 45, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_56(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 46, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_57(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 47, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_60(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 48, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_61(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 49, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_62(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 50, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_63(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 51, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_64(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 52, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_65(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 53, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_66(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 54, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_67(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 55, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_70(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 56, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_71(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 57, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_72(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 58, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_73(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 59, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_74(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 60, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_75(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 61, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_76(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 62, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: nounwind
define dso_local ptr @method_77(ptr noundef %0, ptr noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = tail call fastcc ptr @method(i64 noundef 63, ptr noundef %0, ptr noundef %1, i64 noundef %2)
  ret ptr %4
}

; Function Attrs: mustprogress nocallback nofree nosync nounwind readnone speculatable willreturn
declare double @llvm.fabs.f64(double) #6

; Function Attrs: nocallback nofree nosync nounwind readnone speculatable willreturn
declare i64 @llvm.smax.i64(i64, i64) #7

attributes #0 = { nounwind }
attributes #1 = { argmemonly mustprogress nocallback nofree nosync nounwind willreturn }
attributes #2 = { argmemonly mustprogress nocallback nofree nounwind willreturn writeonly }
attributes #3 = { argmemonly mustprogress nocallback nofree nounwind willreturn }
attributes #4 = { mustprogress nofree norecurse nosync nounwind willreturn writeonly }
attributes #5 = { noinline nounwind }
attributes #6 = { mustprogress nocallback nofree nosync nounwind readnone speculatable willreturn }
attributes #7 = { nocallback nofree nosync nounwind readnone speculatable willreturn }
attributes #8 = { nounwind }

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
!11 = distinct !{!11, !2, !3}
!12 = distinct !{!12, !2, !3}
!13 = distinct !{!13, !2, !3}
!14 = distinct !{!14, !2, !3}
!15 = distinct !{!15, !2, !3}
!16 = distinct !{!16, !2, !3}
!17 = distinct !{!17, !2, !3}
!18 = distinct !{!18, !2, !3}
!19 = distinct !{!19, !2, !3}
!20 = distinct !{!20, !2, !3}
!21 = distinct !{!21, !2, !3}
!22 = distinct !{!22, !2, !3}
!23 = distinct !{!23, !2, !3}
