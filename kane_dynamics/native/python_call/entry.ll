
%struct.array = type { %struct.object, ptr, i32, i32, ptr, ptr, ptr, ptr, i32, i32, ptr }
%struct.object = type { i32, i32, ptr }
%struct.table = type { ptr, ptr, ptr, ptr, ptr, i64, ptr, i64, i64, i64, ptr, i64, i64, ptr, i64, ptr, ptr, ptr, ptr }
%struct.interpreter = type { ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr, ptr }
%struct.argument = type { i64, i64, i64, ptr, double, i64, ptr, ptr }
%struct.tuple = type { %struct.object, i64, [0 x ptr] }
%struct.real = type { %struct.object, double }
%struct.part = type { i64, ptr, i64, i64, i64, i64 }
%struct.lanes = type { ptr, ptr, i64, i64 }
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
  %8 = alloca [11 x i64], align 16
  %9 = alloca [32 x ptr], align 16
  %10 = alloca [32 x ptr], align 16
  %11 = getelementptr inbounds %struct.array, ptr %0, i64 0, i32 1
  %12 = load ptr, ptr %11, align 8
  %13 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 1
  %14 = load ptr, ptr %13, align 8
  %15 = icmp eq ptr %3, null
  br i1 %15, label %16, label %18

16:                                               ; preds = %4
  %17 = icmp sgt i64 %2, 32
  br i1 %17, label %23, label %29

18:                                               ; preds = %4
  %19 = getelementptr inbounds %struct.tuple, ptr %3, i64 0, i32 1
  %20 = load i64, ptr %19, align 8
  %21 = add nsw i64 %20, %2
  %22 = icmp sgt i64 %21, 32
  br i1 %22, label %23, label %232

23:                                               ; preds = %18, %16
  %24 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 17
  %25 = load ptr, ptr %24, align 8
  %26 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 2
  %27 = load ptr, ptr %26, align 8
  %28 = tail call ptr %25(ptr noundef %27, ptr noundef %1, i64 noundef %2, ptr noundef %3) #8
  br label %361

29:                                               ; preds = %16
  %30 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 18
  %31 = load ptr, ptr %30, align 8
  %32 = icmp eq ptr %31, null
  br i1 %32, label %226, label %33

33:                                               ; preds = %29
  %34 = load ptr, ptr %31, align 8
  %35 = icmp eq ptr %34, null
  br i1 %35, label %226, label %36

36:                                               ; preds = %33
  %37 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 7
  %38 = load i64, ptr %37, align 8
  %39 = icmp eq i64 %38, 0
  br i1 %39, label %40, label %226

40:                                               ; preds = %36
  %41 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 5
  %42 = load i64, ptr %41, align 8
  %43 = icmp eq i64 %42, %2
  br i1 %43, label %44, label %226

44:                                               ; preds = %40
  %45 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 11
  %46 = load i64, ptr %45, align 8
  %47 = icmp sgt i64 %46, -1
  br i1 %47, label %226, label %48

48:                                               ; preds = %44
  %49 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 12
  %50 = load i64, ptr %49, align 8
  %51 = icmp sgt i64 %50, 1
  br i1 %51, label %226, label %52

52:                                               ; preds = %48
  call void @llvm.lifetime.start.p0(i64 1024, ptr nonnull %6) #8
  %53 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 9
  %54 = load i64, ptr %53, align 8
  %55 = shl nsw i64 %54, 5
  call void @llvm.memset.p0.i64(ptr nonnull align 16 %6, i8 0, i64 %55, i1 false)
  %56 = icmp sgt i64 %2, 0
  br i1 %56, label %57, label %223

57:                                               ; preds = %52
  %58 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 6
  %59 = load ptr, ptr %58, align 8
  %60 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 1
  br label %61

61:                                               ; preds = %120, %57
  %62 = phi i1 [ true, %57 ], [ %133, %120 ]
  %63 = phi i64 [ 0, %57 ], [ %121, %120 ]
  %64 = phi i64 [ 0, %57 ], [ %132, %120 ]
  %65 = getelementptr inbounds ptr, ptr %1, i64 %64
  %66 = load ptr, ptr %65, align 8
  %67 = getelementptr inbounds %struct.argument, ptr %59, i64 %64, i32 1
  %68 = load i64, ptr %67, align 8
  %69 = getelementptr inbounds %struct.argument, ptr %59, i64 %64, i32 5
  %70 = load i64, ptr %69, align 8
  %71 = getelementptr inbounds %struct.object, ptr %66, i64 0, i32 2
  %72 = load ptr, ptr %71, align 8
  %73 = load ptr, ptr %14, align 8
  %74 = icmp eq ptr %72, %73
  br i1 %74, label %75, label %223

75:                                               ; preds = %61
  %76 = add nsw i64 %68, 1
  %77 = getelementptr inbounds %struct.array, ptr %66, i64 0, i32 2
  %78 = load i32, ptr %77, align 8
  %79 = sext i32 %78 to i64
  %80 = icmp eq i64 %76, %79
  br i1 %80, label %81, label %223

81:                                               ; preds = %75
  %82 = getelementptr inbounds %struct.array, ptr %66, i64 0, i32 7
  %83 = load ptr, ptr %82, align 8
  %84 = load ptr, ptr %60, align 8
  %85 = icmp eq ptr %83, %84
  br i1 %85, label %86, label %223

86:                                               ; preds = %81
  %87 = getelementptr inbounds %struct.array, ptr %66, i64 0, i32 8
  %88 = load i32, ptr %87, align 8
  %89 = sext i32 %88 to i64
  %90 = and i64 %70, %89
  %91 = icmp eq i64 %90, %70
  br i1 %91, label %92, label %223

92:                                               ; preds = %86
  %93 = getelementptr inbounds %struct.argument, ptr %59, i64 %64, i32 3
  %94 = load ptr, ptr %93, align 8
  %95 = icmp sgt i64 %68, 0
  %96 = getelementptr inbounds %struct.array, ptr %66, i64 0, i32 4
  %97 = load ptr, ptr %96, align 8
  br i1 %95, label %98, label %115

98:                                               ; preds = %92
  %99 = getelementptr inbounds i64, ptr %97, i64 1
  %100 = load i64, ptr %99, align 8
  %101 = load i64, ptr %94, align 8
  %102 = icmp eq i64 %100, %101
  br i1 %102, label %103, label %135

103:                                              ; preds = %98, %106
  %104 = phi i64 [ %107, %106 ], [ 1, %98 ]
  %105 = icmp eq i64 %104, %68
  br i1 %105, label %115, label %106, !llvm.loop !7

106:                                              ; preds = %103
  %107 = add nuw nsw i64 %104, 1
  %108 = getelementptr inbounds i64, ptr %97, i64 %107
  %109 = load i64, ptr %108, align 8
  %110 = getelementptr inbounds i64, ptr %94, i64 %104
  %111 = load i64, ptr %110, align 8
  %112 = icmp eq i64 %109, %111
  br i1 %112, label %103, label %113, !llvm.loop !7

113:                                              ; preds = %106
  %114 = icmp slt i64 %104, %68
  br i1 %114, label %135, label %115

115:                                              ; preds = %103, %92, %113
  %116 = icmp eq i64 %64, 0
  %117 = load i64, ptr %97, align 8
  br i1 %116, label %120, label %118

118:                                              ; preds = %115
  %119 = icmp eq i64 %117, %63
  br i1 %119, label %120, label %135

120:                                              ; preds = %118, %115
  %121 = phi i64 [ %63, %118 ], [ %117, %115 ]
  %122 = getelementptr inbounds %struct.array, ptr %66, i64 0, i32 1
  %123 = load ptr, ptr %122, align 8
  %124 = ptrtoint ptr %123 to i64
  %125 = shl nsw i64 %64, 2
  %126 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %125
  store i64 %124, ptr %126, align 16
  %127 = getelementptr inbounds %struct.argument, ptr %59, i64 %64, i32 2
  %128 = load i64, ptr %127, align 8
  %129 = shl nsw i64 %128, 3
  %130 = or i64 %125, 1
  %131 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %130
  store i64 %129, ptr %131, align 8
  %132 = add nuw nsw i64 %64, 1
  %133 = icmp slt i64 %132, %2
  %134 = icmp eq i64 %132, %2
  br i1 %134, label %135, label %61, !llvm.loop !18

135:                                              ; preds = %120, %118, %113, %98
  %136 = phi i64 [ %121, %120 ], [ %63, %118 ], [ %63, %98 ], [ %63, %113 ]
  %137 = phi i1 [ %133, %120 ], [ %62, %118 ], [ %62, %98 ], [ %62, %113 ]
  %138 = icmp slt i64 %136, 1
  %139 = select i1 %137, i1 true, i1 %138
  br i1 %139, label %223, label %140

140:                                              ; preds = %135
  %141 = getelementptr inbounds %struct.lanes, ptr %31, i64 0, i32 3
  %142 = load i64, ptr %141, align 8
  %143 = icmp sgt i64 %136, %142
  br i1 %143, label %223, label %144

144:                                              ; preds = %140
  %145 = add nsw i64 %54, -1
  %146 = icmp sgt i64 %145, %2
  br i1 %146, label %147, label %150

147:                                              ; preds = %144
  %148 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 10
  %149 = load ptr, ptr %148, align 8
  br label %152

150:                                              ; preds = %152, %144
  call void @llvm.lifetime.start.p0(i64 64, ptr nonnull %7) #8
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 16 dereferenceable(64) %7, i8 0, i64 64, i1 false)
  store i64 %136, ptr %7, align 16
  %151 = icmp eq i64 %50, 0
  br i1 %151, label %168, label %161

152:                                              ; preds = %152, %147
  %153 = phi i64 [ %2, %147 ], [ %159, %152 ]
  %154 = getelementptr inbounds ptr, ptr %149, i64 %153
  %155 = load ptr, ptr %154, align 8
  %156 = ptrtoint ptr %155 to i64
  %157 = shl nsw i64 %153, 2
  %158 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %157
  store i64 %156, ptr %158, align 16
  %159 = add nsw i64 %153, 1
  %160 = icmp eq i64 %159, %145
  br i1 %160, label %150, label %152, !llvm.loop !19

161:                                              ; preds = %150
  %162 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 13
  %163 = load ptr, ptr %162, align 8
  %164 = load i64, ptr %163, align 8
  %165 = icmp sgt i64 %164, 0
  br i1 %165, label %166, label %168

166:                                              ; preds = %161
  %167 = getelementptr inbounds %struct.part, ptr %163, i64 0, i32 1
  br label %178

168:                                              ; preds = %178, %161, %150
  %169 = phi i64 [ %164, %161 ], [ 0, %150 ], [ %164, %178 ]
  %170 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 9
  %171 = load ptr, ptr %170, align 8
  %172 = load ptr, ptr %14, align 8
  %173 = trunc i64 %169 to i32
  %174 = add nsw i32 %173, 1
  %175 = call ptr %171(ptr noundef %172, i32 noundef %174, ptr noundef nonnull %7, i32 noundef 12, ptr noundef null, ptr noundef null, i32 noundef 0, i32 noundef 0, ptr noundef null) #8
  %176 = icmp eq ptr %175, null
  %177 = zext i1 %176 to i8
  br i1 %176, label %221, label %186

178:                                              ; preds = %178, %166
  %179 = phi i64 [ 0, %166 ], [ %183, %178 ]
  %180 = load ptr, ptr %167, align 8
  %181 = getelementptr inbounds i64, ptr %180, i64 %179
  %182 = load i64, ptr %181, align 8
  %183 = add nuw nsw i64 %179, 1
  %184 = getelementptr inbounds [8 x i64], ptr %7, i64 0, i64 %183
  store i64 %182, ptr %184, align 8
  %185 = icmp eq i64 %183, %164
  br i1 %185, label %168, label %178, !llvm.loop !20

186:                                              ; preds = %168
  %187 = getelementptr inbounds %struct.array, ptr %175, i64 0, i32 1
  %188 = load ptr, ptr %187, align 8
  %189 = ptrtoint ptr %188 to i64
  %190 = load i64, ptr %53, align 8
  %191 = shl i64 %190, 2
  %192 = add i64 %191, -4
  %193 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %192
  store i64 %189, ptr %193, align 16
  %194 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 14
  %195 = load i64, ptr %194, align 8
  %196 = shl nsw i64 %195, 3
  %197 = add i64 %191, -3
  %198 = getelementptr inbounds [128 x i64], ptr %6, i64 0, i64 %197
  store i64 %196, ptr %198, align 8
  call void @llvm.lifetime.start.p0(i64 88, ptr nonnull %8) #8
  %199 = load ptr, ptr %30, align 8
  %200 = load ptr, ptr %199, align 8
  %201 = ptrtoint ptr %200 to i64
  store i64 %201, ptr %8, align 16
  %202 = getelementptr inbounds i64, ptr %8, i64 1
  %203 = ptrtoint ptr %6 to i64
  store i64 %203, ptr %202, align 8
  %204 = getelementptr inbounds i64, ptr %8, i64 2
  store i64 %190, ptr %204, align 16
  %205 = getelementptr inbounds i64, ptr %8, i64 3
  %206 = getelementptr inbounds i64, ptr %8, i64 7
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 8 dereferenceable(32) %205, i8 0, i64 32, i1 false)
  store i64 %136, ptr %206, align 8
  %207 = getelementptr inbounds i64, ptr %8, i64 8
  store i64 1, ptr %207, align 16
  %208 = getelementptr inbounds i64, ptr %8, i64 9
  %209 = getelementptr inbounds %struct.lanes, ptr %199, i64 0, i32 2
  %210 = load i64, ptr %209, align 8
  store i64 %210, ptr %208, align 8
  %211 = getelementptr inbounds i64, ptr %8, i64 10
  store i64 0, ptr %211, align 16
  %212 = getelementptr inbounds %struct.lanes, ptr %199, i64 0, i32 1
  %213 = load ptr, ptr %212, align 8
  %214 = call i64 %213(ptr noundef nonnull %8, i64 noundef 0, i64 noundef %136) #8
  %215 = icmp eq i64 %214, 0
  br i1 %215, label %219, label %216

216:                                              ; preds = %186
  %217 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 15
  %218 = load ptr, ptr %217, align 8
  call void %218(ptr noundef nonnull %175) #8
  br label %219

219:                                              ; preds = %216, %186
  %220 = phi ptr [ null, %216 ], [ %175, %186 ]
  call void @llvm.lifetime.end.p0(i64 88, ptr nonnull %8) #8
  br label %221

221:                                              ; preds = %219, %168
  %222 = phi ptr [ %220, %219 ], [ null, %168 ]
  call void @llvm.lifetime.end.p0(i64 64, ptr nonnull %7) #8
  br label %223

223:                                              ; preds = %86, %81, %75, %61, %221, %140, %135, %52
  %224 = phi i8 [ 0, %135 ], [ 0, %140 ], [ %177, %221 ], [ 0, %52 ], [ 0, %61 ], [ 0, %75 ], [ 0, %81 ], [ 0, %86 ]
  %225 = phi ptr [ null, %135 ], [ null, %140 ], [ %222, %221 ], [ null, %52 ], [ null, %61 ], [ null, %75 ], [ null, %81 ], [ null, %86 ]
  call void @llvm.lifetime.end.p0(i64 1024, ptr nonnull %6) #8
  br label %226

226:                                              ; preds = %29, %33, %36, %40, %44, %48, %223
  %227 = phi i8 [ 0, %29 ], [ 0, %33 ], [ 0, %44 ], [ 0, %48 ], [ %224, %223 ], [ 0, %40 ], [ 0, %36 ]
  %228 = phi ptr [ null, %29 ], [ null, %33 ], [ null, %44 ], [ null, %48 ], [ %225, %223 ], [ null, %40 ], [ null, %36 ]
  %229 = icmp eq ptr %228, null
  %230 = icmp eq i8 %227, 0
  %231 = select i1 %229, i1 %230, i1 false
  br i1 %231, label %232, label %361

232:                                              ; preds = %18, %226
  %233 = phi i64 [ %2, %226 ], [ %21, %18 ]
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %9) #8
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %10) #8
  %234 = icmp sgt i64 %233, 0
  br i1 %234, label %235, label %339

235:                                              ; preds = %232
  %236 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 5
  %237 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 6
  %238 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 9
  %239 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 2
  %240 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 4
  %241 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 3
  %242 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 12
  %243 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 13
  %244 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 14
  %245 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 15
  br label %249

246:                                              ; preds = %328
  %247 = icmp ne i64 %330, 0
  %248 = select i1 %334, i1 %247, i1 false
  br i1 %248, label %336, label %338

249:                                              ; preds = %235, %328
  %250 = phi i64 [ 0, %235 ], [ %331, %328 ]
  %251 = phi i64 [ 0, %235 ], [ %330, %328 ]
  %252 = phi i8 [ 0, %235 ], [ %329, %328 ]
  %253 = getelementptr inbounds ptr, ptr %1, i64 %250
  %254 = load ptr, ptr %253, align 8
  %255 = getelementptr inbounds [32 x ptr], ptr %9, i64 0, i64 %250
  store ptr %254, ptr %255, align 8
  %256 = icmp slt i64 %250, %2
  br i1 %256, label %257, label %328

257:                                              ; preds = %249
  %258 = getelementptr inbounds %struct.object, ptr %254, i64 0, i32 2
  %259 = load ptr, ptr %258, align 8
  %260 = load ptr, ptr %236, align 8
  %261 = icmp eq ptr %259, %260
  br i1 %261, label %265, label %262

262:                                              ; preds = %257
  %263 = load ptr, ptr %237, align 8
  %264 = icmp eq ptr %259, %263
  br i1 %264, label %265, label %328

265:                                              ; preds = %262, %257
  call void @llvm.lifetime.start.p0(i64 8, ptr nonnull %5) #8
  %266 = getelementptr inbounds %struct.list, ptr %254, i64 0, i32 1
  %267 = load i64, ptr %266, align 8
  store i64 %267, ptr %5, align 8
  %268 = load ptr, ptr %238, align 8
  %269 = load ptr, ptr %14, align 8
  %270 = call ptr %268(ptr noundef %269, i32 noundef 1, ptr noundef nonnull %5, i32 noundef 12, ptr noundef null, ptr noundef null, i32 noundef 0, i32 noundef 0, ptr noundef null) #8
  %271 = icmp eq ptr %270, null
  %272 = zext i1 %271 to i8
  br i1 %271, label %324, label %273

273:                                              ; preds = %265
  br i1 %261, label %274, label %277

274:                                              ; preds = %273
  %275 = getelementptr inbounds %struct.list, ptr %254, i64 0, i32 2
  %276 = load ptr, ptr %275, align 8
  br label %279

277:                                              ; preds = %273
  %278 = getelementptr inbounds %struct.tuple, ptr %254, i64 0, i32 2
  br label %279

279:                                              ; preds = %277, %274
  %280 = phi ptr [ %276, %274 ], [ %278, %277 ]
  %281 = load i64, ptr %266, align 8
  %282 = load i64, ptr %5, align 8
  %283 = icmp eq i64 %281, %282
  %284 = icmp sgt i64 %282, 0
  %285 = and i1 %283, %284
  br i1 %285, label %286, label %288

286:                                              ; preds = %279
  %287 = getelementptr inbounds %struct.array, ptr %270, i64 0, i32 1
  br label %289

288:                                              ; preds = %279
  br i1 %283, label %325, label %322

289:                                              ; preds = %318, %286
  %290 = phi i64 [ 0, %286 ], [ %319, %318 ]
  %291 = load ptr, ptr %287, align 8
  %292 = getelementptr inbounds double, ptr %291, i64 %290
  %293 = getelementptr inbounds ptr, ptr %280, i64 %290
  %294 = load ptr, ptr %293, align 8
  %295 = getelementptr inbounds %struct.object, ptr %294, i64 0, i32 2
  %296 = load ptr, ptr %295, align 8
  %297 = load ptr, ptr %239, align 8
  %298 = icmp eq ptr %296, %297
  br i1 %298, label %302, label %299

299:                                              ; preds = %289
  %300 = load ptr, ptr %240, align 8
  %301 = icmp eq ptr %296, %300
  br i1 %301, label %302, label %305

302:                                              ; preds = %299, %289
  %303 = getelementptr inbounds %struct.real, ptr %294, i64 0, i32 1
  %304 = load double, ptr %303, align 8
  store double %304, ptr %292, align 8
  br label %318

305:                                              ; preds = %299
  %306 = load ptr, ptr %241, align 8
  %307 = icmp eq ptr %296, %306
  br i1 %307, label %308, label %322

308:                                              ; preds = %305
  %309 = load ptr, ptr %242, align 8
  %310 = call double %309(ptr noundef nonnull %294) #8
  store double %310, ptr %292, align 8
  %311 = fcmp oeq double %310, -1.000000e+00
  br i1 %311, label %312, label %318

312:                                              ; preds = %308
  %313 = load ptr, ptr %243, align 8
  %314 = call ptr %313() #8
  %315 = icmp eq ptr %314, null
  br i1 %315, label %318, label %316

316:                                              ; preds = %312
  %317 = load ptr, ptr %244, align 8
  call void %317() #8
  br label %322

318:                                              ; preds = %312, %308, %302
  %319 = add nuw nsw i64 %290, 1
  %320 = load i64, ptr %5, align 8
  %321 = icmp slt i64 %319, %320
  br i1 %321, label %289, label %325, !llvm.loop !21

322:                                              ; preds = %305, %316, %288
  %323 = load ptr, ptr %245, align 8
  call void %323(ptr noundef nonnull %270) #8
  br label %324

324:                                              ; preds = %265, %322
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %5) #8
  br label %328

325:                                              ; preds = %318, %288
  call void @llvm.lifetime.end.p0(i64 8, ptr nonnull %5) #8
  %326 = add nsw i64 %251, 1
  %327 = getelementptr inbounds [32 x ptr], ptr %10, i64 0, i64 %251
  store ptr %270, ptr %327, align 8
  store ptr %270, ptr %255, align 8
  br label %328

328:                                              ; preds = %262, %249, %324, %325
  %329 = phi i8 [ %272, %325 ], [ %272, %324 ], [ %252, %249 ], [ %252, %262 ]
  %330 = phi i64 [ %326, %325 ], [ %251, %324 ], [ %251, %249 ], [ %251, %262 ]
  %331 = add nuw nsw i64 %250, 1
  %332 = icmp slt i64 %331, %233
  %333 = and i8 %329, 1
  %334 = icmp eq i8 %333, 0
  %335 = select i1 %332, i1 %334, i1 false
  br i1 %335, label %249, label %246, !llvm.loop !22

336:                                              ; preds = %246
  %337 = call ptr @entry(ptr noundef %0, ptr noundef nonnull %9, i64 noundef %2, ptr noundef %3)
  br label %347

338:                                              ; preds = %246
  br i1 %334, label %339, label %347

339:                                              ; preds = %232, %338
  %340 = phi i64 [ %330, %338 ], [ 0, %232 ]
  %341 = load ptr, ptr %13, align 8
  %342 = getelementptr inbounds %struct.interpreter, ptr %341, i64 0, i32 17
  %343 = load ptr, ptr %342, align 8
  %344 = getelementptr inbounds %struct.table, ptr %12, i64 0, i32 2
  %345 = load ptr, ptr %344, align 8
  %346 = call ptr %343(ptr noundef %345, ptr noundef %1, i64 noundef %2, ptr noundef %3) #8
  br label %347

347:                                              ; preds = %338, %339, %336
  %348 = phi i64 [ %330, %336 ], [ %330, %338 ], [ %340, %339 ]
  %349 = phi ptr [ %337, %336 ], [ null, %338 ], [ %346, %339 ]
  %350 = icmp sgt i64 %348, 0
  br i1 %350, label %351, label %360

351:                                              ; preds = %347
  %352 = getelementptr inbounds %struct.interpreter, ptr %14, i64 0, i32 15
  br label %353

353:                                              ; preds = %353, %351
  %354 = phi i64 [ 0, %351 ], [ %358, %353 ]
  %355 = load ptr, ptr %352, align 8
  %356 = getelementptr inbounds ptr, ptr %10, i64 %354
  %357 = load ptr, ptr %356, align 8
  call void %355(ptr noundef %357) #8
  %358 = add nuw nsw i64 %354, 1
  %359 = icmp eq i64 %358, %348
  br i1 %359, label %360, label %353, !llvm.loop !13

360:                                              ; preds = %353, %347
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %10) #8
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %9) #8
  br label %361

361:                                              ; preds = %360, %226, %23
  %362 = phi ptr [ %28, %23 ], [ %349, %360 ], [ %228, %226 ]
  ret ptr %362
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
