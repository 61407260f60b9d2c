
%struct.job = type { ptr, ptr, i64, i64, ptr, ptr, i64, i64, i64, i64, i64 }
%struct.row = type { ptr, i64, i64, ptr }
%struct.threads = type { ptr, ptr, i64, i64 }
%union.pthread_attr_t = type { i64, [48 x i8] }
%struct.share = type { i64, i64, ptr, i64, [32 x i8] }
%struct.described = type { ptr, i64, i64, i64, i64, i64, ptr, ptr }

; Function Attrs: nounwind
define dso_local void @repeat(ptr nocapture noundef readonly %0) local_unnamed_addr #0 {
  %2 = alloca [32 x ptr], align 16
  %3 = load i64, ptr %0, align 8
  %4 = inttoptr i64 %3 to ptr
  %5 = getelementptr inbounds i64, ptr %0, i64 2
  %6 = load i64, ptr %5, align 8
  %7 = getelementptr inbounds i64, ptr %0, i64 3
  %8 = getelementptr inbounds i64, ptr %7, i64 %6
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %2) #10
  %9 = shl i64 %6, 3
  call void @llvm.memcpy.p0.p0.i64(ptr nonnull align 16 %2, ptr nonnull align 8 %7, i64 %9, i1 false)
  %10 = getelementptr inbounds i64, ptr %0, i64 1
  %11 = load i64, ptr %10, align 8
  %12 = icmp sgt i64 %11, 0
  br i1 %12, label %13, label %15

13:                                               ; preds = %1
  %14 = icmp sgt i64 %6, 0
  br label %16

15:                                               ; preds = %18, %1
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %2) #10
  ret void

16:                                               ; preds = %13, %18
  %17 = phi i64 [ 0, %13 ], [ %19, %18 ]
  call void %4(ptr noundef nonnull %2) #10
  br i1 %14, label %22, label %18

18:                                               ; preds = %22, %16
  %19 = add nuw nsw i64 %17, 1
  %20 = load i64, ptr %10, align 8
  %21 = icmp slt i64 %19, %20
  br i1 %21, label %16, label %15, !llvm.loop !1

22:                                               ; preds = %16, %22
  %23 = phi i64 [ %29, %22 ], [ 0, %16 ]
  %24 = getelementptr inbounds i64, ptr %8, i64 %23
  %25 = load i64, ptr %24, align 8
  %26 = getelementptr inbounds [32 x ptr], ptr %2, i64 0, i64 %23
  %27 = load ptr, ptr %26, align 8
  %28 = getelementptr inbounds i8, ptr %27, i64 %25
  store ptr %28, ptr %26, align 8
  %29 = add nuw nsw i64 %23, 1
  %30 = icmp eq i64 %29, %6
  br i1 %30, label %18, label %22, !llvm.loop !4
}

; Function Attrs: argmemonly mustprogress nocallback nofree nosync nounwind willreturn
declare void @llvm.lifetime.start.p0(i64 immarg, ptr nocapture) #1

; Function Attrs: argmemonly mustprogress nocallback nofree nounwind willreturn
declare void @llvm.memcpy.p0.p0.i64(ptr noalias nocapture writeonly, ptr noalias nocapture readonly, i64, i1 immarg) #2

; Function Attrs: argmemonly mustprogress nocallback nofree nosync nounwind willreturn
declare void @llvm.lifetime.end.p0(i64 immarg, ptr nocapture) #1

; Function Attrs: nounwind
define dso_local i64 @run_batch(ptr nocapture noundef readonly %0, i64 noundef %1, i64 noundef %2) local_unnamed_addr #0 {
  %4 = alloca [256 x ptr], align 64
  %5 = alloca [16 x i64], align 64
  %6 = alloca [8 x i64], align 16
  %7 = alloca [32 x i64], align 16
  %8 = alloca [256 x ptr], align 64
  %9 = alloca [16 x i64], align 64
  %10 = alloca [8 x i64], align 16
  %11 = alloca [32 x i64], align 16
  %12 = alloca [256 x ptr], align 64
  %13 = alloca [16 x i64], align 64
  %14 = alloca [8 x i64], align 16
  %15 = alloca [32 x i64], align 16
  %16 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 9
  %17 = load i64, ptr %16, align 8
  switch i64 %17, label %390 [
    i64 8, label %18
    i64 4, label %204
  ]

18:                                               ; preds = %3
  call void @llvm.lifetime.start.p0(i64 2048, ptr nonnull %12) #10
  call void @llvm.lifetime.start.p0(i64 128, ptr nonnull %13) #10
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 64 dereferenceable(128) %13, i8 0, i64 128, i1 false)
  call void @llvm.lifetime.start.p0(i64 64, ptr nonnull %14) #10
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %15) #10
  %19 = load ptr, ptr %0, align 8
  %20 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 8
  %21 = load i64, ptr %20, align 8
  %22 = icmp eq i64 %21, 1
  %23 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 2
  %24 = load i64, ptr %23, align 8
  %25 = icmp sgt i64 %24, 0
  br i1 %25, label %26, label %29

26:                                               ; preds = %18
  %27 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 1
  %28 = load ptr, ptr %27, align 8
  br label %39

29:                                               ; preds = %50, %18
  %30 = phi i1 [ %22, %18 ], [ %51, %50 ]
  %31 = icmp slt i64 %1, %2
  br i1 %31, label %33, label %32

32:                                               ; preds = %54, %29
  br label %185

33:                                               ; preds = %29
  %34 = add nsw i64 %2, -1
  %35 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 1
  %36 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 4
  %37 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 3
  %38 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 5
  br label %56

39:                                               ; preds = %50, %26
  %40 = phi i1 [ %22, %26 ], [ %51, %50 ]
  %41 = phi i64 [ 0, %26 ], [ %52, %50 ]
  %42 = getelementptr inbounds %struct.row, ptr %28, i64 %41, i32 1
  %43 = load i64, ptr %42, align 8
  %44 = shl nsw i64 %43, 3
  %45 = getelementptr inbounds [32 x i64], ptr %15, i64 0, i64 %41
  store i64 %44, ptr %45, align 8
  br i1 %40, label %46, label %50

46:                                               ; preds = %39
  %47 = getelementptr inbounds %struct.row, ptr %28, i64 %41, i32 3
  %48 = load ptr, ptr %47, align 8
  %49 = icmp eq ptr %48, null
  br label %50

50:                                               ; preds = %46, %39
  %51 = phi i1 [ false, %39 ], [ %49, %46 ]
  %52 = add nuw nsw i64 %41, 1
  %53 = icmp eq i64 %52, %24
  br i1 %53, label %29, label %39, !llvm.loop !5

54:                                               ; preds = %159
  %55 = icmp slt i64 %59, %2
  br i1 %55, label %56, label %32, !llvm.loop !6

56:                                               ; preds = %54, %33
  %57 = phi i64 [ %1, %33 ], [ %59, %54 ]
  br label %68

58:                                               ; preds = %68
  %59 = add nsw i64 %57, 8
  %60 = load i64, ptr %23, align 8
  %61 = icmp sgt i64 %60, 0
  br i1 %61, label %62, label %115

62:                                               ; preds = %58
  %63 = icmp sgt i64 %57, %1
  %64 = icmp sle i64 %59, %2
  %65 = select i1 %63, i1 %64, i1 false
  %66 = load ptr, ptr %35, align 8
  %67 = select i1 %65, i1 %30, i1 false
  br label %76

68:                                               ; preds = %68, %56
  %69 = phi i64 [ %74, %68 ], [ 0, %56 ]
  %70 = add nsw i64 %69, %57
  %71 = icmp slt i64 %70, %2
  %72 = select i1 %71, i64 %70, i64 %34
  %73 = getelementptr inbounds [8 x i64], ptr %14, i64 0, i64 %69
  store i64 %72, ptr %73, align 8
  %74 = add nuw nsw i64 %69, 1
  %75 = icmp eq i64 %74, 8
  br i1 %75, label %58, label %68, !llvm.loop !7

76:                                               ; preds = %112, %62
  %77 = phi i64 [ 0, %62 ], [ %113, %112 ]
  %78 = getelementptr inbounds %struct.row, ptr %66, i64 %77
  %79 = shl nsw i64 %77, 3
  %80 = getelementptr inbounds ptr, ptr %12, i64 %79
  br i1 %67, label %84, label %81

81:                                               ; preds = %76
  %82 = getelementptr inbounds %struct.row, ptr %66, i64 %77, i32 3
  %83 = getelementptr inbounds %struct.row, ptr %66, i64 %77, i32 1
  br label %94

84:                                               ; preds = %76
  %85 = getelementptr inbounds [32 x i64], ptr %15, i64 0, i64 %77
  %86 = load i64, ptr %85, align 8
  br label %87

87:                                               ; preds = %87, %84
  %88 = phi i64 [ 0, %84 ], [ %92, %87 ]
  %89 = getelementptr inbounds ptr, ptr %80, i64 %88
  %90 = load ptr, ptr %89, align 8
  %91 = getelementptr inbounds i8, ptr %90, i64 %86
  store ptr %91, ptr %89, align 8
  %92 = add nuw nsw i64 %88, 1
  %93 = icmp eq i64 %92, 8
  br i1 %93, label %112, label %87, !llvm.loop !8

94:                                               ; preds = %102, %81
  %95 = phi i64 [ 0, %81 ], [ %110, %102 ]
  %96 = load ptr, ptr %82, align 8
  %97 = icmp eq ptr %96, null
  %98 = getelementptr inbounds [8 x i64], ptr %14, i64 0, i64 %95
  br i1 %97, label %102, label %99

99:                                               ; preds = %94
  %100 = load i64, ptr %98, align 8
  %101 = getelementptr inbounds i64, ptr %96, i64 %100
  br label %102

102:                                              ; preds = %99, %94
  %103 = phi ptr [ %101, %99 ], [ %98, %94 ]
  %104 = load i64, ptr %103, align 8
  %105 = load ptr, ptr %78, align 8
  %106 = load i64, ptr %83, align 8
  %107 = mul nsw i64 %106, %104
  %108 = getelementptr inbounds i8, ptr %105, i64 %107
  %109 = getelementptr inbounds ptr, ptr %80, i64 %95
  store ptr %108, ptr %109, align 8
  %110 = add nuw nsw i64 %95, 1
  %111 = icmp eq i64 %110, 8
  br i1 %111, label %112, label %94, !llvm.loop !9

112:                                              ; preds = %102, %87
  %113 = add nuw nsw i64 %77, 1
  %114 = icmp eq i64 %113, %60
  br i1 %114, label %115, label %76, !llvm.loop !10

115:                                              ; preds = %112, %58
  br label %116

116:                                              ; preds = %166, %115
  %117 = phi i64 [ 0, %115 ], [ %160, %166 ]
  call void %19(ptr noundef nonnull %12, ptr noundef nonnull %13) #10
  %118 = load ptr, ptr %36, align 8
  %119 = icmp eq ptr %118, null
  br i1 %119, label %159, label %120

120:                                              ; preds = %116
  %121 = load i64, ptr %37, align 8
  br label %122

122:                                              ; preds = %155, %120
  %123 = phi i64 [ %121, %120 ], [ %156, %155 ]
  %124 = phi i64 [ 0, %120 ], [ %157, %155 ]
  %125 = getelementptr inbounds [8 x i64], ptr %14, i64 0, i64 %124
  %126 = load i64, ptr %125, align 8
  %127 = load i64, ptr %23, align 8
  %128 = shl i64 %127, 3
  %129 = add nuw nsw i64 %124, -8
  %130 = add i64 %129, %128
  %131 = getelementptr inbounds [256 x ptr], ptr %12, i64 0, i64 %130
  %132 = load ptr, ptr %131, align 8
  %133 = load ptr, ptr %36, align 8
  %134 = mul nsw i64 %126, %123
  %135 = getelementptr inbounds double, ptr %133, i64 %134
  %136 = load ptr, ptr %38, align 8
  %137 = getelementptr inbounds double, ptr %136, i64 %134
  %138 = icmp sgt i64 %123, 0
  br i1 %138, label %139, label %155

139:                                              ; preds = %122, %139
  %140 = phi i64 [ %152, %139 ], [ 0, %122 ]
  %141 = getelementptr inbounds double, ptr %132, i64 %140
  %142 = load double, ptr %141, align 8
  %143 = getelementptr inbounds double, ptr %135, i64 %140
  %144 = load double, ptr %143, align 8
  %145 = fcmp olt double %142, %144
  %146 = select i1 %145, double %142, double %144
  store double %146, ptr %143, align 8
  %147 = load double, ptr %141, align 8
  %148 = getelementptr inbounds double, ptr %137, i64 %140
  %149 = load double, ptr %148, align 8
  %150 = fcmp ogt double %147, %149
  %151 = select i1 %150, double %147, double %149
  store double %151, ptr %148, align 8
  %152 = add nuw nsw i64 %140, 1
  %153 = load i64, ptr %37, align 8
  %154 = icmp slt i64 %152, %153
  br i1 %154, label %139, label %155, !llvm.loop !11

155:                                              ; preds = %139, %122
  %156 = phi i64 [ %123, %122 ], [ %153, %139 ]
  %157 = add nuw nsw i64 %124, 1
  %158 = icmp eq i64 %157, 8
  br i1 %158, label %159, label %122, !llvm.loop !12

159:                                              ; preds = %155, %116
  %160 = add nuw nsw i64 %117, 1
  %161 = load i64, ptr %20, align 8
  %162 = icmp slt i64 %160, %161
  br i1 %162, label %163, label %54

163:                                              ; preds = %159
  %164 = load i64, ptr %23, align 8
  %165 = icmp sgt i64 %164, 0
  br i1 %165, label %167, label %166

166:                                              ; preds = %173, %163
  br label %116, !llvm.loop !13

167:                                              ; preds = %163
  %168 = load ptr, ptr %35, align 8
  br label %169

169:                                              ; preds = %167, %173
  %170 = phi i64 [ %174, %173 ], [ 0, %167 ]
  %171 = getelementptr inbounds %struct.row, ptr %168, i64 %170, i32 2
  %172 = shl nsw i64 %170, 3
  br label %176

173:                                              ; preds = %176
  %174 = add nuw nsw i64 %170, 1
  %175 = icmp eq i64 %174, %164
  br i1 %175, label %166, label %169, !llvm.loop !13

176:                                              ; preds = %176, %169
  %177 = phi i64 [ 0, %169 ], [ %183, %176 ]
  %178 = load i64, ptr %171, align 8
  %179 = add nuw nsw i64 %177, %172
  %180 = getelementptr inbounds [256 x ptr], ptr %12, i64 0, i64 %179
  %181 = load ptr, ptr %180, align 8
  %182 = getelementptr inbounds i8, ptr %181, i64 %178
  store ptr %182, ptr %180, align 8
  %183 = add nuw nsw i64 %177, 1
  %184 = icmp eq i64 %183, 8
  br i1 %184, label %173, label %176, !llvm.loop !14

185:                                              ; preds = %32, %185
  %186 = phi i64 [ %196, %185 ], [ 0, %32 ]
  %187 = phi i64 [ %195, %185 ], [ 0, %32 ]
  %188 = phi i64 [ %191, %185 ], [ 0, %32 ]
  %189 = getelementptr inbounds [16 x i64], ptr %13, i64 0, i64 %186
  %190 = load i64, ptr %189, align 8
  %191 = or i64 %190, %188
  %192 = add nuw nsw i64 %186, 8
  %193 = getelementptr inbounds [16 x i64], ptr %13, i64 0, i64 %192
  %194 = load i64, ptr %193, align 8
  %195 = or i64 %194, %187
  %196 = add nuw nsw i64 %186, 1
  %197 = icmp eq i64 %196, 8
  br i1 %197, label %198, label %185, !llvm.loop !15

198:                                              ; preds = %185
  %199 = icmp ne i64 %191, 0
  %200 = zext i1 %199 to i64
  %201 = icmp eq i64 %195, 0
  %202 = select i1 %201, i64 0, i64 2
  %203 = or i64 %202, %200
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %15) #10
  call void @llvm.lifetime.end.p0(i64 64, ptr nonnull %14) #10
  call void @llvm.lifetime.end.p0(i64 128, ptr nonnull %13) #10
  call void @llvm.lifetime.end.p0(i64 2048, ptr nonnull %12) #10
  br label %576

204:                                              ; preds = %3
  call void @llvm.lifetime.start.p0(i64 2048, ptr nonnull %8) #10
  call void @llvm.lifetime.start.p0(i64 128, ptr nonnull %9) #10
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 64 dereferenceable(128) %9, i8 0, i64 128, i1 false)
  call void @llvm.lifetime.start.p0(i64 64, ptr nonnull %10) #10
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %11) #10
  %205 = load ptr, ptr %0, align 8
  %206 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 8
  %207 = load i64, ptr %206, align 8
  %208 = icmp eq i64 %207, 1
  %209 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 2
  %210 = load i64, ptr %209, align 8
  %211 = icmp sgt i64 %210, 0
  br i1 %211, label %212, label %215

212:                                              ; preds = %204
  %213 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 1
  %214 = load ptr, ptr %213, align 8
  br label %225

215:                                              ; preds = %236, %204
  %216 = phi i1 [ %208, %204 ], [ %237, %236 ]
  %217 = icmp slt i64 %1, %2
  br i1 %217, label %219, label %218

218:                                              ; preds = %240, %215
  br label %371

219:                                              ; preds = %215
  %220 = add nsw i64 %2, -1
  %221 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 1
  %222 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 4
  %223 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 3
  %224 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 5
  br label %242

225:                                              ; preds = %236, %212
  %226 = phi i1 [ %208, %212 ], [ %237, %236 ]
  %227 = phi i64 [ 0, %212 ], [ %238, %236 ]
  %228 = getelementptr inbounds %struct.row, ptr %214, i64 %227, i32 1
  %229 = load i64, ptr %228, align 8
  %230 = shl nsw i64 %229, 2
  %231 = getelementptr inbounds [32 x i64], ptr %11, i64 0, i64 %227
  store i64 %230, ptr %231, align 8
  br i1 %226, label %232, label %236

232:                                              ; preds = %225
  %233 = getelementptr inbounds %struct.row, ptr %214, i64 %227, i32 3
  %234 = load ptr, ptr %233, align 8
  %235 = icmp eq ptr %234, null
  br label %236

236:                                              ; preds = %232, %225
  %237 = phi i1 [ false, %225 ], [ %235, %232 ]
  %238 = add nuw nsw i64 %227, 1
  %239 = icmp eq i64 %238, %210
  br i1 %239, label %215, label %225, !llvm.loop !5

240:                                              ; preds = %345
  %241 = icmp slt i64 %245, %2
  br i1 %241, label %242, label %218, !llvm.loop !6

242:                                              ; preds = %240, %219
  %243 = phi i64 [ %1, %219 ], [ %245, %240 ]
  br label %254

244:                                              ; preds = %254
  %245 = add nsw i64 %243, 4
  %246 = load i64, ptr %209, align 8
  %247 = icmp sgt i64 %246, 0
  br i1 %247, label %248, label %301

248:                                              ; preds = %244
  %249 = icmp sgt i64 %243, %1
  %250 = icmp sle i64 %245, %2
  %251 = select i1 %249, i1 %250, i1 false
  %252 = load ptr, ptr %221, align 8
  %253 = select i1 %251, i1 %216, i1 false
  br label %262

254:                                              ; preds = %254, %242
  %255 = phi i64 [ %260, %254 ], [ 0, %242 ]
  %256 = add nsw i64 %255, %243
  %257 = icmp slt i64 %256, %2
  %258 = select i1 %257, i64 %256, i64 %220
  %259 = getelementptr inbounds [8 x i64], ptr %10, i64 0, i64 %255
  store i64 %258, ptr %259, align 8
  %260 = add nuw nsw i64 %255, 1
  %261 = icmp eq i64 %260, 4
  br i1 %261, label %244, label %254, !llvm.loop !7

262:                                              ; preds = %298, %248
  %263 = phi i64 [ 0, %248 ], [ %299, %298 ]
  %264 = getelementptr inbounds %struct.row, ptr %252, i64 %263
  %265 = shl nsw i64 %263, 2
  %266 = getelementptr inbounds ptr, ptr %8, i64 %265
  br i1 %253, label %270, label %267

267:                                              ; preds = %262
  %268 = getelementptr inbounds %struct.row, ptr %252, i64 %263, i32 3
  %269 = getelementptr inbounds %struct.row, ptr %252, i64 %263, i32 1
  br label %280

270:                                              ; preds = %262
  %271 = getelementptr inbounds [32 x i64], ptr %11, i64 0, i64 %263
  %272 = load i64, ptr %271, align 8
  br label %273

273:                                              ; preds = %273, %270
  %274 = phi i64 [ 0, %270 ], [ %278, %273 ]
  %275 = getelementptr inbounds ptr, ptr %266, i64 %274
  %276 = load ptr, ptr %275, align 8
  %277 = getelementptr inbounds i8, ptr %276, i64 %272
  store ptr %277, ptr %275, align 8
  %278 = add nuw nsw i64 %274, 1
  %279 = icmp eq i64 %278, 4
  br i1 %279, label %298, label %273, !llvm.loop !8

280:                                              ; preds = %288, %267
  %281 = phi i64 [ 0, %267 ], [ %296, %288 ]
  %282 = load ptr, ptr %268, align 8
  %283 = icmp eq ptr %282, null
  %284 = getelementptr inbounds [8 x i64], ptr %10, i64 0, i64 %281
  br i1 %283, label %288, label %285

285:                                              ; preds = %280
  %286 = load i64, ptr %284, align 8
  %287 = getelementptr inbounds i64, ptr %282, i64 %286
  br label %288

288:                                              ; preds = %285, %280
  %289 = phi ptr [ %287, %285 ], [ %284, %280 ]
  %290 = load i64, ptr %289, align 8
  %291 = load ptr, ptr %264, align 8
  %292 = load i64, ptr %269, align 8
  %293 = mul nsw i64 %292, %290
  %294 = getelementptr inbounds i8, ptr %291, i64 %293
  %295 = getelementptr inbounds ptr, ptr %266, i64 %281
  store ptr %294, ptr %295, align 8
  %296 = add nuw nsw i64 %281, 1
  %297 = icmp eq i64 %296, 4
  br i1 %297, label %298, label %280, !llvm.loop !9

298:                                              ; preds = %288, %273
  %299 = add nuw nsw i64 %263, 1
  %300 = icmp eq i64 %299, %246
  br i1 %300, label %301, label %262, !llvm.loop !10

301:                                              ; preds = %298, %244
  br label %302

302:                                              ; preds = %352, %301
  %303 = phi i64 [ 0, %301 ], [ %346, %352 ]
  call void %205(ptr noundef nonnull %8, ptr noundef nonnull %9) #10
  %304 = load ptr, ptr %222, align 8
  %305 = icmp eq ptr %304, null
  br i1 %305, label %345, label %306

306:                                              ; preds = %302
  %307 = load i64, ptr %223, align 8
  br label %308

308:                                              ; preds = %341, %306
  %309 = phi i64 [ %307, %306 ], [ %342, %341 ]
  %310 = phi i64 [ 0, %306 ], [ %343, %341 ]
  %311 = getelementptr inbounds [8 x i64], ptr %10, i64 0, i64 %310
  %312 = load i64, ptr %311, align 8
  %313 = load i64, ptr %209, align 8
  %314 = shl i64 %313, 2
  %315 = add nuw nsw i64 %310, -4
  %316 = add i64 %315, %314
  %317 = getelementptr inbounds [256 x ptr], ptr %8, i64 0, i64 %316
  %318 = load ptr, ptr %317, align 8
  %319 = load ptr, ptr %222, align 8
  %320 = mul nsw i64 %312, %309
  %321 = getelementptr inbounds double, ptr %319, i64 %320
  %322 = load ptr, ptr %224, align 8
  %323 = getelementptr inbounds double, ptr %322, i64 %320
  %324 = icmp sgt i64 %309, 0
  br i1 %324, label %325, label %341

325:                                              ; preds = %308, %325
  %326 = phi i64 [ %338, %325 ], [ 0, %308 ]
  %327 = getelementptr inbounds double, ptr %318, i64 %326
  %328 = load double, ptr %327, align 8
  %329 = getelementptr inbounds double, ptr %321, i64 %326
  %330 = load double, ptr %329, align 8
  %331 = fcmp olt double %328, %330
  %332 = select i1 %331, double %328, double %330
  store double %332, ptr %329, align 8
  %333 = load double, ptr %327, align 8
  %334 = getelementptr inbounds double, ptr %323, i64 %326
  %335 = load double, ptr %334, align 8
  %336 = fcmp ogt double %333, %335
  %337 = select i1 %336, double %333, double %335
  store double %337, ptr %334, align 8
  %338 = add nuw nsw i64 %326, 1
  %339 = load i64, ptr %223, align 8
  %340 = icmp slt i64 %338, %339
  br i1 %340, label %325, label %341, !llvm.loop !11

341:                                              ; preds = %325, %308
  %342 = phi i64 [ %309, %308 ], [ %339, %325 ]
  %343 = add nuw nsw i64 %310, 1
  %344 = icmp eq i64 %343, 4
  br i1 %344, label %345, label %308, !llvm.loop !12

345:                                              ; preds = %341, %302
  %346 = add nuw nsw i64 %303, 1
  %347 = load i64, ptr %206, align 8
  %348 = icmp slt i64 %346, %347
  br i1 %348, label %349, label %240

349:                                              ; preds = %345
  %350 = load i64, ptr %209, align 8
  %351 = icmp sgt i64 %350, 0
  br i1 %351, label %353, label %352

352:                                              ; preds = %359, %349
  br label %302, !llvm.loop !13

353:                                              ; preds = %349
  %354 = load ptr, ptr %221, align 8
  br label %355

355:                                              ; preds = %353, %359
  %356 = phi i64 [ %360, %359 ], [ 0, %353 ]
  %357 = getelementptr inbounds %struct.row, ptr %354, i64 %356, i32 2
  %358 = shl nsw i64 %356, 2
  br label %362

359:                                              ; preds = %362
  %360 = add nuw nsw i64 %356, 1
  %361 = icmp eq i64 %360, %350
  br i1 %361, label %352, label %355, !llvm.loop !13

362:                                              ; preds = %362, %355
  %363 = phi i64 [ 0, %355 ], [ %369, %362 ]
  %364 = load i64, ptr %357, align 8
  %365 = add nuw nsw i64 %363, %358
  %366 = getelementptr inbounds [256 x ptr], ptr %8, i64 0, i64 %365
  %367 = load ptr, ptr %366, align 8
  %368 = getelementptr inbounds i8, ptr %367, i64 %364
  store ptr %368, ptr %366, align 8
  %369 = add nuw nsw i64 %363, 1
  %370 = icmp eq i64 %369, 4
  br i1 %370, label %359, label %362, !llvm.loop !14

371:                                              ; preds = %218, %371
  %372 = phi i64 [ %382, %371 ], [ 0, %218 ]
  %373 = phi i64 [ %381, %371 ], [ 0, %218 ]
  %374 = phi i64 [ %377, %371 ], [ 0, %218 ]
  %375 = getelementptr inbounds [16 x i64], ptr %9, i64 0, i64 %372
  %376 = load i64, ptr %375, align 8
  %377 = or i64 %376, %374
  %378 = add nuw nsw i64 %372, 4
  %379 = getelementptr inbounds [16 x i64], ptr %9, i64 0, i64 %378
  %380 = load i64, ptr %379, align 8
  %381 = or i64 %380, %373
  %382 = add nuw nsw i64 %372, 1
  %383 = icmp eq i64 %382, 4
  br i1 %383, label %384, label %371, !llvm.loop !15

384:                                              ; preds = %371
  %385 = icmp ne i64 %377, 0
  %386 = zext i1 %385 to i64
  %387 = icmp eq i64 %381, 0
  %388 = select i1 %387, i64 0, i64 2
  %389 = or i64 %388, %386
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %11) #10
  call void @llvm.lifetime.end.p0(i64 64, ptr nonnull %10) #10
  call void @llvm.lifetime.end.p0(i64 128, ptr nonnull %9) #10
  call void @llvm.lifetime.end.p0(i64 2048, ptr nonnull %8) #10
  br label %576

390:                                              ; preds = %3
  call void @llvm.lifetime.start.p0(i64 2048, ptr nonnull %4) #10
  call void @llvm.lifetime.start.p0(i64 128, ptr nonnull %5) #10
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 64 dereferenceable(128) %5, i8 0, i64 128, i1 false)
  call void @llvm.lifetime.start.p0(i64 64, ptr nonnull %6) #10
  call void @llvm.lifetime.start.p0(i64 256, ptr nonnull %7) #10
  %391 = load ptr, ptr %0, align 8
  %392 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 8
  %393 = load i64, ptr %392, align 8
  %394 = icmp eq i64 %393, 1
  %395 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 2
  %396 = load i64, ptr %395, align 8
  %397 = icmp sgt i64 %396, 0
  br i1 %397, label %398, label %401

398:                                              ; preds = %390
  %399 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 1
  %400 = load ptr, ptr %399, align 8
  br label %411

401:                                              ; preds = %422, %390
  %402 = phi i1 [ %394, %390 ], [ %423, %422 ]
  %403 = icmp slt i64 %1, %2
  br i1 %403, label %405, label %404

404:                                              ; preds = %426, %401
  br label %557

405:                                              ; preds = %401
  %406 = add nsw i64 %2, -1
  %407 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 1
  %408 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 4
  %409 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 3
  %410 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 5
  br label %428

411:                                              ; preds = %422, %398
  %412 = phi i1 [ %394, %398 ], [ %423, %422 ]
  %413 = phi i64 [ 0, %398 ], [ %424, %422 ]
  %414 = getelementptr inbounds %struct.row, ptr %400, i64 %413, i32 1
  %415 = load i64, ptr %414, align 8
  %416 = shl nsw i64 %415, 1
  %417 = getelementptr inbounds [32 x i64], ptr %7, i64 0, i64 %413
  store i64 %416, ptr %417, align 8
  br i1 %412, label %418, label %422

418:                                              ; preds = %411
  %419 = getelementptr inbounds %struct.row, ptr %400, i64 %413, i32 3
  %420 = load ptr, ptr %419, align 8
  %421 = icmp eq ptr %420, null
  br label %422

422:                                              ; preds = %418, %411
  %423 = phi i1 [ false, %411 ], [ %421, %418 ]
  %424 = add nuw nsw i64 %413, 1
  %425 = icmp eq i64 %424, %396
  br i1 %425, label %401, label %411, !llvm.loop !5

426:                                              ; preds = %531
  %427 = icmp slt i64 %431, %2
  br i1 %427, label %428, label %404, !llvm.loop !6

428:                                              ; preds = %426, %405
  %429 = phi i64 [ %1, %405 ], [ %431, %426 ]
  br label %440

430:                                              ; preds = %440
  %431 = add nsw i64 %429, 2
  %432 = load i64, ptr %395, align 8
  %433 = icmp sgt i64 %432, 0
  br i1 %433, label %434, label %487

434:                                              ; preds = %430
  %435 = icmp sgt i64 %429, %1
  %436 = icmp sle i64 %431, %2
  %437 = select i1 %435, i1 %436, i1 false
  %438 = load ptr, ptr %407, align 8
  %439 = select i1 %437, i1 %402, i1 false
  br label %448

440:                                              ; preds = %440, %428
  %441 = phi i64 [ %446, %440 ], [ 0, %428 ]
  %442 = add nsw i64 %441, %429
  %443 = icmp slt i64 %442, %2
  %444 = select i1 %443, i64 %442, i64 %406
  %445 = getelementptr inbounds [8 x i64], ptr %6, i64 0, i64 %441
  store i64 %444, ptr %445, align 8
  %446 = add nuw nsw i64 %441, 1
  %447 = icmp eq i64 %446, 2
  br i1 %447, label %430, label %440, !llvm.loop !7

448:                                              ; preds = %484, %434
  %449 = phi i64 [ 0, %434 ], [ %485, %484 ]
  %450 = getelementptr inbounds %struct.row, ptr %438, i64 %449
  %451 = shl nuw nsw i64 %449, 1
  %452 = getelementptr inbounds ptr, ptr %4, i64 %451
  br i1 %439, label %456, label %453

453:                                              ; preds = %448
  %454 = getelementptr inbounds %struct.row, ptr %438, i64 %449, i32 3
  %455 = getelementptr inbounds %struct.row, ptr %438, i64 %449, i32 1
  br label %466

456:                                              ; preds = %448
  %457 = getelementptr inbounds [32 x i64], ptr %7, i64 0, i64 %449
  %458 = load i64, ptr %457, align 8
  br label %459

459:                                              ; preds = %459, %456
  %460 = phi i64 [ 0, %456 ], [ %464, %459 ]
  %461 = getelementptr inbounds ptr, ptr %452, i64 %460
  %462 = load ptr, ptr %461, align 8
  %463 = getelementptr inbounds i8, ptr %462, i64 %458
  store ptr %463, ptr %461, align 8
  %464 = add nuw nsw i64 %460, 1
  %465 = icmp eq i64 %464, 2
  br i1 %465, label %484, label %459, !llvm.loop !8

466:                                              ; preds = %474, %453
  %467 = phi i64 [ 0, %453 ], [ %482, %474 ]
  %468 = load ptr, ptr %454, align 8
  %469 = icmp eq ptr %468, null
  %470 = getelementptr inbounds [8 x i64], ptr %6, i64 0, i64 %467
  br i1 %469, label %474, label %471

471:                                              ; preds = %466
  %472 = load i64, ptr %470, align 8
  %473 = getelementptr inbounds i64, ptr %468, i64 %472
  br label %474

474:                                              ; preds = %471, %466
  %475 = phi ptr [ %473, %471 ], [ %470, %466 ]
  %476 = load i64, ptr %475, align 8
  %477 = load ptr, ptr %450, align 8
  %478 = load i64, ptr %455, align 8
  %479 = mul nsw i64 %478, %476
  %480 = getelementptr inbounds i8, ptr %477, i64 %479
  %481 = getelementptr inbounds ptr, ptr %452, i64 %467
  store ptr %480, ptr %481, align 8
  %482 = add nuw nsw i64 %467, 1
  %483 = icmp eq i64 %482, 2
  br i1 %483, label %484, label %466, !llvm.loop !9

484:                                              ; preds = %474, %459
  %485 = add nuw nsw i64 %449, 1
  %486 = icmp eq i64 %485, %432
  br i1 %486, label %487, label %448, !llvm.loop !10

487:                                              ; preds = %484, %430
  br label %488

488:                                              ; preds = %538, %487
  %489 = phi i64 [ 0, %487 ], [ %532, %538 ]
  call void %391(ptr noundef nonnull %4, ptr noundef nonnull %5) #10
  %490 = load ptr, ptr %408, align 8
  %491 = icmp eq ptr %490, null
  br i1 %491, label %531, label %492

492:                                              ; preds = %488
  %493 = load i64, ptr %409, align 8
  br label %494

494:                                              ; preds = %527, %492
  %495 = phi i64 [ %493, %492 ], [ %528, %527 ]
  %496 = phi i64 [ 0, %492 ], [ %529, %527 ]
  %497 = getelementptr inbounds [8 x i64], ptr %6, i64 0, i64 %496
  %498 = load i64, ptr %497, align 8
  %499 = load i64, ptr %395, align 8
  %500 = shl i64 %499, 1
  %501 = add nuw nsw i64 %496, -2
  %502 = add i64 %501, %500
  %503 = getelementptr inbounds [256 x ptr], ptr %4, i64 0, i64 %502
  %504 = load ptr, ptr %503, align 8
  %505 = load ptr, ptr %408, align 8
  %506 = mul nsw i64 %498, %495
  %507 = getelementptr inbounds double, ptr %505, i64 %506
  %508 = load ptr, ptr %410, align 8
  %509 = getelementptr inbounds double, ptr %508, i64 %506
  %510 = icmp sgt i64 %495, 0
  br i1 %510, label %511, label %527

511:                                              ; preds = %494, %511
  %512 = phi i64 [ %524, %511 ], [ 0, %494 ]
  %513 = getelementptr inbounds double, ptr %504, i64 %512
  %514 = load double, ptr %513, align 8
  %515 = getelementptr inbounds double, ptr %507, i64 %512
  %516 = load double, ptr %515, align 8
  %517 = fcmp olt double %514, %516
  %518 = select i1 %517, double %514, double %516
  store double %518, ptr %515, align 8
  %519 = load double, ptr %513, align 8
  %520 = getelementptr inbounds double, ptr %509, i64 %512
  %521 = load double, ptr %520, align 8
  %522 = fcmp ogt double %519, %521
  %523 = select i1 %522, double %519, double %521
  store double %523, ptr %520, align 8
  %524 = add nuw nsw i64 %512, 1
  %525 = load i64, ptr %409, align 8
  %526 = icmp slt i64 %524, %525
  br i1 %526, label %511, label %527, !llvm.loop !11

527:                                              ; preds = %511, %494
  %528 = phi i64 [ %495, %494 ], [ %525, %511 ]
  %529 = add nuw nsw i64 %496, 1
  %530 = icmp eq i64 %529, 2
  br i1 %530, label %531, label %494, !llvm.loop !12

531:                                              ; preds = %527, %488
  %532 = add nuw nsw i64 %489, 1
  %533 = load i64, ptr %392, align 8
  %534 = icmp slt i64 %532, %533
  br i1 %534, label %535, label %426

535:                                              ; preds = %531
  %536 = load i64, ptr %395, align 8
  %537 = icmp sgt i64 %536, 0
  br i1 %537, label %539, label %538

538:                                              ; preds = %545, %535
  br label %488, !llvm.loop !13

539:                                              ; preds = %535
  %540 = load ptr, ptr %407, align 8
  br label %541

541:                                              ; preds = %539, %545
  %542 = phi i64 [ %546, %545 ], [ 0, %539 ]
  %543 = getelementptr inbounds %struct.row, ptr %540, i64 %542, i32 2
  %544 = shl nuw nsw i64 %542, 1
  br label %548

545:                                              ; preds = %548
  %546 = add nuw nsw i64 %542, 1
  %547 = icmp eq i64 %546, %536
  br i1 %547, label %538, label %541, !llvm.loop !13

548:                                              ; preds = %548, %541
  %549 = phi i64 [ 0, %541 ], [ %555, %548 ]
  %550 = load i64, ptr %543, align 8
  %551 = add nuw nsw i64 %549, %544
  %552 = getelementptr inbounds [256 x ptr], ptr %4, i64 0, i64 %551
  %553 = load ptr, ptr %552, align 8
  %554 = getelementptr inbounds i8, ptr %553, i64 %550
  store ptr %554, ptr %552, align 8
  %555 = add nuw nsw i64 %549, 1
  %556 = icmp eq i64 %555, 2
  br i1 %556, label %545, label %548, !llvm.loop !14

557:                                              ; preds = %404, %557
  %558 = phi i64 [ %568, %557 ], [ 0, %404 ]
  %559 = phi i64 [ %567, %557 ], [ 0, %404 ]
  %560 = phi i64 [ %563, %557 ], [ 0, %404 ]
  %561 = getelementptr inbounds [16 x i64], ptr %5, i64 0, i64 %558
  %562 = load i64, ptr %561, align 8
  %563 = or i64 %562, %560
  %564 = add nuw nsw i64 %558, 2
  %565 = getelementptr inbounds [16 x i64], ptr %5, i64 0, i64 %564
  %566 = load i64, ptr %565, align 8
  %567 = or i64 %566, %559
  %568 = add nuw nsw i64 %558, 1
  %569 = icmp eq i64 %568, 2
  br i1 %569, label %570, label %557, !llvm.loop !15

570:                                              ; preds = %557
  %571 = icmp ne i64 %563, 0
  %572 = zext i1 %571 to i64
  %573 = icmp eq i64 %567, 0
  %574 = select i1 %573, i64 0, i64 2
  %575 = or i64 %574, %572
  call void @llvm.lifetime.end.p0(i64 256, ptr nonnull %7) #10
  call void @llvm.lifetime.end.p0(i64 64, ptr nonnull %6) #10
  call void @llvm.lifetime.end.p0(i64 128, ptr nonnull %5) #10
  call void @llvm.lifetime.end.p0(i64 2048, ptr nonnull %4) #10
  br label %576

576:                                              ; preds = %570, %384, %198
  %577 = phi i64 [ %203, %198 ], [ %389, %384 ], [ %575, %570 ]
  ret i64 %577
}

; Function Attrs: nounwind
define dso_local void @run_job(ptr noundef %0, i64 noundef %1) local_unnamed_addr #0 {
  %3 = alloca %struct.threads, align 8
  %4 = alloca %union.pthread_attr_t, align 8
  %5 = shl i64 %1, 6
  %6 = add i64 %5, 64
  %7 = alloca i8, i64 %6, align 16
  %8 = ptrtoint ptr %7 to i64
  %9 = add i64 %8, 63
  %10 = and i64 %9, -64
  %11 = inttoptr i64 %10 to ptr
  %12 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 7
  %13 = load i64, ptr %12, align 8
  %14 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 6
  %15 = load i64, ptr %14, align 8
  %16 = sub nsw i64 %13, %15
  %17 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 9
  %18 = load i64, ptr %17, align 8
  %19 = add i64 %18, -1
  %20 = add i64 %19, %16
  %21 = sdiv i64 %20, %18
  %22 = sdiv i64 %16, %5
  %23 = sdiv i64 %22, %18
  %24 = add nsw i64 %23, 1
  %25 = mul nsw i64 %24, %18
  call void @llvm.lifetime.start.p0(i64 32, ptr nonnull %3) #10
  store ptr %0, ptr %3, align 8
  %26 = getelementptr inbounds %struct.threads, ptr %3, i64 0, i32 1
  store ptr %11, ptr %26, align 8
  %27 = getelementptr inbounds %struct.threads, ptr %3, i64 0, i32 2
  store i64 %1, ptr %27, align 8
  %28 = getelementptr inbounds %struct.threads, ptr %3, i64 0, i32 3
  store i64 %25, ptr %28, align 8
  %29 = getelementptr inbounds %struct.job, ptr %0, i64 0, i32 10
  store atomic i64 0, ptr %29 seq_cst, align 8
  %30 = icmp sgt i64 %1, 0
  br i1 %30, label %35, label %31

31:                                               ; preds = %35, %2
  call void @llvm.lifetime.start.p0(i64 56, ptr nonnull %4) #10
  %32 = call i32 @pthread_attr_init(ptr noundef nonnull %4) #10
  %33 = call i32 @pthread_attr_setstacksize(ptr noundef nonnull %4, i64 noundef 8388608) #10
  %34 = icmp sgt i64 %1, 1
  br i1 %34, label %50, label %59

35:                                               ; preds = %2, %35
  %36 = phi i64 [ %43, %35 ], [ %15, %2 ]
  %37 = phi i64 [ %39, %35 ], [ 0, %2 ]
  %38 = load i64, ptr %14, align 8
  %39 = add nuw nsw i64 %37, 1
  %40 = mul nsw i64 %39, %21
  %41 = sdiv i64 %40, %1
  %42 = mul nsw i64 %41, %18
  %43 = add nsw i64 %42, %38
  %44 = getelementptr inbounds %struct.share, ptr %11, i64 %37
  store atomic i64 %36, ptr %44 seq_cst, align 64
  %45 = load i64, ptr %12, align 8
  %46 = call i64 @llvm.smin.i64(i64 %43, i64 %45)
  %47 = getelementptr inbounds %struct.share, ptr %11, i64 %37, i32 1
  store i64 %46, ptr %47, align 8
  %48 = getelementptr inbounds %struct.share, ptr %11, i64 %37, i32 2
  store ptr %3, ptr %48, align 16
  %49 = icmp eq i64 %39, %1
  br i1 %49, label %31, label %35, !llvm.loop !16

50:                                               ; preds = %31, %56
  %51 = phi i64 [ %57, %56 ], [ 1, %31 ]
  %52 = getelementptr inbounds %struct.share, ptr %11, i64 %51
  %53 = getelementptr inbounds %struct.share, ptr %11, i64 %51, i32 3
  %54 = call i32 @pthread_create(ptr noundef nonnull %53, ptr noundef nonnull %4, ptr noundef nonnull @run_pieces, ptr noundef nonnull %52) #10
  %55 = icmp eq i32 %54, 0
  br i1 %55, label %56, label %59

56:                                               ; preds = %50
  %57 = add nuw nsw i64 %51, 1
  %58 = icmp eq i64 %57, %1
  br i1 %58, label %59, label %50, !llvm.loop !17

59:                                               ; preds = %50, %56, %31
  %60 = phi i64 [ 1, %31 ], [ %1, %56 ], [ %51, %50 ]
  %61 = getelementptr inbounds %struct.share, ptr %11, i64 0, i32 2
  %62 = load ptr, ptr %61, align 16
  %63 = getelementptr inbounds %struct.threads, ptr %62, i64 0, i32 2
  %64 = load i64, ptr %63, align 8
  %65 = icmp sgt i64 %64, 0
  br i1 %65, label %66, label %102

66:                                               ; preds = %59
  %67 = getelementptr inbounds %struct.threads, ptr %62, i64 0, i32 3
  %68 = getelementptr inbounds %struct.threads, ptr %62, i64 0, i32 1
  br label %69

69:                                               ; preds = %92, %66
  %70 = phi ptr [ %11, %66 ], [ %99, %92 ]
  %71 = phi i64 [ 0, %66 ], [ %93, %92 ]
  %72 = phi i64 [ 0, %66 ], [ %100, %92 ]
  %73 = getelementptr inbounds %struct.share, ptr %70, i64 0, i32 1
  %74 = load i64, ptr %67, align 8
  %75 = atomicrmw add ptr %70, i64 %74 monotonic, align 8
  %76 = load i64, ptr %73, align 8
  %77 = icmp slt i64 %75, %76
  br i1 %77, label %78, label %92

78:                                               ; preds = %69, %78
  %79 = phi i64 [ %90, %78 ], [ %76, %69 ]
  %80 = phi i64 [ %89, %78 ], [ %75, %69 ]
  %81 = phi i64 [ %87, %78 ], [ %71, %69 ]
  %82 = load i64, ptr %67, align 8
  %83 = add nsw i64 %82, %80
  %84 = load ptr, ptr %62, align 8
  %85 = call i64 @llvm.smin.i64(i64 %83, i64 %79)
  %86 = call i64 @run_batch(ptr noundef %84, i64 noundef %80, i64 noundef %85)
  %87 = or i64 %86, %81
  %88 = load i64, ptr %67, align 8
  %89 = atomicrmw add ptr %70, i64 %88 monotonic, align 8
  %90 = load i64, ptr %73, align 8
  %91 = icmp slt i64 %89, %90
  br i1 %91, label %78, label %92

92:                                               ; preds = %78, %69
  %93 = phi i64 [ %71, %69 ], [ %87, %78 ]
  %94 = getelementptr inbounds %struct.share, ptr %70, i64 1
  %95 = load ptr, ptr %68, align 8
  %96 = load i64, ptr %63, align 8
  %97 = getelementptr inbounds %struct.share, ptr %95, i64 %96
  %98 = icmp eq ptr %94, %97
  %99 = select i1 %98, ptr %95, ptr %94
  %100 = add nuw nsw i64 %72, 1
  %101 = icmp slt i64 %100, %96
  br i1 %101, label %69, label %102, !llvm.loop !18

102:                                              ; preds = %92, %59
  %103 = phi i64 [ 0, %59 ], [ %93, %92 ]
  %104 = load ptr, ptr %62, align 8
  %105 = getelementptr inbounds %struct.job, ptr %104, i64 0, i32 10
  %106 = atomicrmw or ptr %105, i64 %103 monotonic, align 8
  %107 = icmp ugt i64 %60, 1
  br i1 %107, label %108, label %114

108:                                              ; preds = %102, %127
  %109 = phi i64 [ %129, %127 ], [ 1, %102 ]
  %110 = phi i64 [ %128, %127 ], [ 20000, %102 ]
  %111 = getelementptr inbounds %struct.share, ptr %11, i64 %109, i32 3
  %112 = call i64 @llvm.smin.i64(i64 %110, i64 0)
  %113 = add i64 %112, -1
  br label %116

114:                                              ; preds = %127, %102
  %115 = call i32 @pthread_attr_destroy(ptr noundef nonnull %4) #10
  call void @llvm.lifetime.end.p0(i64 56, ptr nonnull %4) #10
  call void @llvm.lifetime.end.p0(i64 32, ptr nonnull %3) #10
  ret void

116:                                              ; preds = %108, %121
  %117 = phi i64 [ %122, %121 ], [ %110, %108 ]
  %118 = load i64, ptr %111, align 8
  %119 = call i32 @pthread_tryjoin_np(i64 noundef %118, ptr noundef null) #10
  %120 = icmp eq i32 %119, 0
  br i1 %120, label %127, label %121

121:                                              ; preds = %116
  %122 = add nsw i64 %117, -1
  %123 = icmp slt i64 %117, 1
  br i1 %123, label %124, label %116, !llvm.loop !19

124:                                              ; preds = %121
  %125 = load i64, ptr %111, align 8
  %126 = call i32 @pthread_join(i64 noundef %125, ptr noundef null) #10
  br label %127

127:                                              ; preds = %116, %124
  %128 = phi i64 [ %113, %124 ], [ %117, %116 ]
  %129 = add nuw i64 %109, 1
  %130 = icmp eq i64 %129, %60
  br i1 %130, label %114, label %108, !llvm.loop !20
}

; Function Attrs: nounwind
declare dso_local i32 @pthread_attr_init(ptr noundef) local_unnamed_addr #3

; Function Attrs: nounwind
declare dso_local i32 @pthread_attr_setstacksize(ptr noundef, i64 noundef) local_unnamed_addr #3

; Function Attrs: nounwind
declare dso_local i32 @pthread_create(ptr noundef, ptr noundef, ptr noundef, ptr noundef) local_unnamed_addr #3

; Function Attrs: nounwind
define internal noalias ptr @run_pieces(ptr noundef %0) #0 {
  %2 = getelementptr inbounds %struct.share, ptr %0, i64 0, i32 2
  %3 = load ptr, ptr %2, align 16
  %4 = getelementptr inbounds %struct.threads, ptr %3, i64 0, i32 2
  %5 = load i64, ptr %4, align 8
  %6 = icmp sgt i64 %5, 0
  br i1 %6, label %7, label %19

7:                                                ; preds = %1
  %8 = getelementptr inbounds %struct.threads, ptr %3, i64 0, i32 3
  %9 = getelementptr inbounds %struct.threads, ptr %3, i64 0, i32 1
  br label %10

10:                                               ; preds = %7, %38
  %11 = phi ptr [ %0, %7 ], [ %45, %38 ]
  %12 = phi i64 [ 0, %7 ], [ %39, %38 ]
  %13 = phi i64 [ 0, %7 ], [ %46, %38 ]
  %14 = getelementptr inbounds %struct.share, ptr %11, i64 0, i32 1
  %15 = load i64, ptr %8, align 8
  %16 = atomicrmw add ptr %11, i64 %15 monotonic, align 8
  %17 = load i64, ptr %14, align 8
  %18 = icmp slt i64 %16, %17
  br i1 %18, label %24, label %38

19:                                               ; preds = %38, %1
  %20 = phi i64 [ 0, %1 ], [ %39, %38 ]
  %21 = load ptr, ptr %3, align 8
  %22 = getelementptr inbounds %struct.job, ptr %21, i64 0, i32 10
  %23 = atomicrmw or ptr %22, i64 %20 monotonic, align 8
  ret ptr null

24:                                               ; preds = %10, %24
  %25 = phi i64 [ %36, %24 ], [ %17, %10 ]
  %26 = phi i64 [ %35, %24 ], [ %16, %10 ]
  %27 = phi i64 [ %33, %24 ], [ %12, %10 ]
  %28 = load i64, ptr %8, align 8
  %29 = add nsw i64 %28, %26
  %30 = load ptr, ptr %3, align 8
  %31 = tail call i64 @llvm.smin.i64(i64 %29, i64 %25)
  %32 = tail call i64 @run_batch(ptr noundef %30, i64 noundef %26, i64 noundef %31)
  %33 = or i64 %32, %27
  %34 = load i64, ptr %8, align 8
  %35 = atomicrmw add ptr %11, i64 %34 monotonic, align 8
  %36 = load i64, ptr %14, align 8
  %37 = icmp slt i64 %35, %36
  br i1 %37, label %24, label %38

38:                                               ; preds = %24, %10
  %39 = phi i64 [ %12, %10 ], [ %33, %24 ]
  %40 = getelementptr inbounds %struct.share, ptr %11, i64 1
  %41 = load ptr, ptr %9, align 8
  %42 = load i64, ptr %4, align 8
  %43 = getelementptr inbounds %struct.share, ptr %41, i64 %42
  %44 = icmp eq ptr %40, %43
  %45 = select i1 %44, ptr %41, ptr %40
  %46 = add nuw nsw i64 %13, 1
  %47 = icmp slt i64 %46, %42
  br i1 %47, label %10, label %19, !llvm.loop !18
}

; Function Attrs: nounwind
declare dso_local i32 @pthread_tryjoin_np(i64 noundef, ptr noundef) local_unnamed_addr #3

declare dso_local i32 @pthread_join(i64 noundef, ptr noundef) local_unnamed_addr #4

; Function Attrs: nounwind
declare dso_local i32 @pthread_attr_destroy(ptr noundef) local_unnamed_addr #3

; Function Attrs: nounwind
define dso_local noalias ptr @handle(ptr nocapture noundef readonly %0, ptr nocapture noundef readonly %1) local_unnamed_addr #0 {
  %3 = alloca [32 x %struct.row], align 16
  %4 = alloca %struct.job, align 8
  %5 = getelementptr inbounds i8, ptr %0, i64 8
  %6 = load ptr, ptr %5, align 8
  %7 = icmp eq ptr %6, null
  br i1 %7, label %21, label %8

8:                                                ; preds = %2
  %9 = getelementptr inbounds i8, ptr %6, i64 8
  %10 = load i32, ptr %9, align 4
  %11 = icmp eq i32 %10, 1
  br i1 %11, label %12, label %21

12:                                               ; preds = %8
  %13 = getelementptr inbounds i8, ptr %6, i64 24
  %14 = load ptr, ptr %13, align 8
  %15 = getelementptr inbounds i8, ptr %14, i64 24
  store i32 0, ptr %15, align 4
  %16 = getelementptr inbounds %struct.described, ptr %1, i64 0, i32 5
  %17 = load i64, ptr %16, align 8
  %18 = trunc i64 %17 to i32
  %19 = getelementptr inbounds i8, ptr %14, i64 28
  store i32 %18, ptr %19, align 4
  %20 = getelementptr inbounds i8, ptr %14, i64 32
  store i32 0, ptr %20, align 4
  br label %260

21:                                               ; preds = %8, %2
  %22 = getelementptr inbounds i8, ptr %0, i64 72
  %23 = load ptr, ptr %22, align 8
  %24 = getelementptr inbounds i8, ptr %0, i64 112
  %25 = load ptr, ptr %24, align 8
  %26 = load ptr, ptr %25, align 8
  %27 = getelementptr inbounds %struct.described, ptr %1, i64 0, i32 1
  %28 = load i64, ptr %27, align 8
  %29 = add i64 %28, -1
  %30 = getelementptr inbounds i8, ptr %26, i64 32
  %31 = load i64, ptr %30, align 8
  %32 = getelementptr inbounds i8, ptr %26, i64 40
  %33 = load ptr, ptr %32, align 8
  %34 = icmp sgt i64 %31, 0
  br i1 %34, label %35, label %43

35:                                               ; preds = %21, %35
  %36 = phi i64 [ %41, %35 ], [ 0, %21 ]
  %37 = phi i64 [ %40, %35 ], [ 1, %21 ]
  %38 = getelementptr inbounds i64, ptr %33, i64 %36
  %39 = load i64, ptr %38, align 8
  %40 = mul nsw i64 %39, %37
  %41 = add nuw nsw i64 %36, 1
  %42 = icmp eq i64 %41, %31
  br i1 %42, label %43, label %35, !llvm.loop !21

43:                                               ; preds = %35, %21
  %44 = phi i64 [ 1, %21 ], [ %40, %35 ]
  %45 = getelementptr inbounds %struct.described, ptr %1, i64 0, i32 6
  %46 = load ptr, ptr %45, align 8
  %47 = getelementptr inbounds i64, ptr %46, i64 %29
  %48 = load i64, ptr %47, align 8
  %49 = icmp eq i64 %48, 0
  br i1 %49, label %260, label %50

50:                                               ; preds = %43
  %51 = sdiv i64 %44, %48
  %52 = icmp eq i64 %51, 0
  br i1 %52, label %260, label %53

53:                                               ; preds = %50
  %54 = getelementptr inbounds i8, ptr %26, i64 16
  %55 = load i32, ptr %54, align 4
  %56 = icmp eq i32 %55, 11
  call void @llvm.lifetime.start.p0(i64 1024, ptr nonnull %3) #10
  %57 = icmp sgt i64 %28, 1
  br i1 %57, label %58, label %62

58:                                               ; preds = %53
  %59 = add nsw i64 %28, -2
  br label %71

60:                                               ; preds = %91
  %61 = load i64, ptr %47, align 8
  br label %62

62:                                               ; preds = %60, %53
  %63 = phi i64 [ %48, %53 ], [ %61, %60 ]
  %64 = phi i64 [ %44, %53 ], [ %105, %60 ]
  %65 = getelementptr inbounds [32 x %struct.row], ptr %3, i64 0, i64 %29
  %66 = getelementptr inbounds i8, ptr %26, i64 24
  %67 = load ptr, ptr %66, align 8
  %68 = shl nsw i64 %63, 3
  store ptr %67, ptr %65, align 16
  %69 = getelementptr inbounds i8, ptr %65, i64 8
  store i64 %68, ptr %69, align 8
  %70 = getelementptr inbounds i8, ptr %65, i64 16
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 16 dereferenceable(16) %70, i8 0, i64 16, i1 false)
  br i1 %56, label %108, label %161

71:                                               ; preds = %58, %91
  %72 = phi i64 [ %44, %58 ], [ %105, %91 ]
  %73 = phi i64 [ 0, %58 ], [ %106, %91 ]
  %74 = getelementptr inbounds i64, ptr %46, i64 %73
  %75 = load i64, ptr %74, align 8
  %76 = getelementptr inbounds ptr, ptr %23, i64 %73
  %77 = load ptr, ptr %76, align 8
  %78 = getelementptr inbounds i8, ptr %77, i64 32
  %79 = load i64, ptr %78, align 8
  %80 = getelementptr inbounds i8, ptr %77, i64 40
  %81 = load ptr, ptr %80, align 8
  %82 = icmp sgt i64 %79, 0
  br i1 %82, label %83, label %91

83:                                               ; preds = %71, %83
  %84 = phi i64 [ %89, %83 ], [ 0, %71 ]
  %85 = phi i64 [ %88, %83 ], [ 1, %71 ]
  %86 = getelementptr inbounds i64, ptr %81, i64 %84
  %87 = load i64, ptr %86, align 8
  %88 = mul nsw i64 %87, %85
  %89 = add nuw nsw i64 %84, 1
  %90 = icmp eq i64 %89, %79
  br i1 %90, label %91, label %83, !llvm.loop !21

91:                                               ; preds = %83, %71
  %92 = phi i64 [ 1, %71 ], [ %88, %83 ]
  %93 = icmp eq i64 %92, %75
  %94 = icmp eq i64 %73, %59
  %95 = select i1 %93, i1 true, i1 %94
  %96 = getelementptr inbounds [32 x %struct.row], ptr %3, i64 0, i64 %73
  %97 = getelementptr inbounds i8, ptr %77, i64 24
  %98 = load ptr, ptr %97, align 8
  %99 = shl nsw i64 %75, 3
  %100 = select i1 %95, i64 0, i64 %99
  store ptr %98, ptr %96, align 16
  %101 = getelementptr inbounds i8, ptr %96, i64 8
  store i64 %100, ptr %101, align 8
  %102 = getelementptr inbounds i8, ptr %96, i64 16
  %103 = icmp slt i64 %73, %59
  %104 = select i1 %103, i64 %92, i64 0
  %105 = add nsw i64 %104, %72
  %106 = add nuw nsw i64 %73, 1
  %107 = icmp eq i64 %106, %29
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 16 dereferenceable(16) %102, i8 0, i64 16, i1 false)
  br i1 %107, label %60, label %71, !llvm.loop !22

108:                                              ; preds = %62
  %109 = shl i64 %64, 3
  %110 = tail call noalias ptr @malloc(i64 noundef %109) #11
  %111 = icmp eq ptr %110, null
  br i1 %111, label %112, label %114

112:                                              ; preds = %108
  %113 = shl i64 %44, 2
  tail call void @llvm.memset.p0.i64(ptr align 1 %67, i8 -1, i64 %113, i1 false)
  br label %259

114:                                              ; preds = %108
  %115 = icmp sgt i64 %28, 2
  br i1 %115, label %116, label %119

116:                                              ; preds = %114
  %117 = getelementptr inbounds double, ptr %110, i64 %44
  %118 = add i64 %28, -3
  br label %120

119:                                              ; preds = %148, %114
  store ptr %110, ptr %65, align 16
  br label %161

120:                                              ; preds = %116, %148
  %121 = phi i64 [ %150, %148 ], [ 0, %116 ]
  %122 = phi ptr [ %149, %148 ], [ %117, %116 ]
  %123 = getelementptr inbounds ptr, ptr %23, i64 %121
  %124 = load ptr, ptr %123, align 8
  %125 = getelementptr inbounds i8, ptr %124, i64 32
  %126 = load i64, ptr %125, align 8
  %127 = getelementptr inbounds i8, ptr %124, i64 40
  %128 = load ptr, ptr %127, align 8
  %129 = icmp sgt i64 %126, 0
  br i1 %129, label %133, label %130

130:                                              ; preds = %120
  %131 = getelementptr inbounds [32 x %struct.row], ptr %3, i64 0, i64 %121
  %132 = load ptr, ptr %131, align 16
  store ptr %122, ptr %131, align 16
  br label %145

133:                                              ; preds = %120, %133
  %134 = phi i64 [ %139, %133 ], [ 0, %120 ]
  %135 = phi i64 [ %138, %133 ], [ 1, %120 ]
  %136 = getelementptr inbounds i64, ptr %128, i64 %134
  %137 = load i64, ptr %136, align 8
  %138 = mul nsw i64 %137, %135
  %139 = add nuw nsw i64 %134, 1
  %140 = icmp eq i64 %139, %126
  br i1 %140, label %141, label %133, !llvm.loop !21

141:                                              ; preds = %133
  %142 = getelementptr inbounds [32 x %struct.row], ptr %3, i64 0, i64 %121
  %143 = load ptr, ptr %142, align 16
  store ptr %122, ptr %142, align 16
  %144 = icmp sgt i64 %138, 0
  br i1 %144, label %145, label %148

145:                                              ; preds = %130, %141
  %146 = phi ptr [ %132, %130 ], [ %143, %141 ]
  %147 = phi i64 [ 1, %130 ], [ %138, %141 ]
  br label %152

148:                                              ; preds = %152, %141
  %149 = phi ptr [ %122, %141 ], [ %158, %152 ]
  %150 = add nuw nsw i64 %121, 1
  %151 = icmp eq i64 %121, %118
  br i1 %151, label %119, label %120, !llvm.loop !23

152:                                              ; preds = %145, %152
  %153 = phi i64 [ %159, %152 ], [ 0, %145 ]
  %154 = phi ptr [ %158, %152 ], [ %122, %145 ]
  %155 = getelementptr inbounds float, ptr %146, i64 %153
  %156 = load float, ptr %155, align 4
  %157 = fpext float %156 to double
  %158 = getelementptr inbounds double, ptr %154, i64 1
  store double %157, ptr %154, align 8
  %159 = add nuw nsw i64 %153, 1
  %160 = icmp eq i64 %159, %147
  br i1 %160, label %148, label %152, !llvm.loop !24

161:                                              ; preds = %119, %62
  %162 = phi ptr [ %110, %119 ], [ null, %62 ]
  %163 = getelementptr inbounds %struct.described, ptr %1, i64 0, i32 3
  %164 = load i64, ptr %163, align 8
  %165 = sdiv i64 %51, %164
  %166 = icmp slt i64 %165, 1
  br i1 %166, label %171, label %167

167:                                              ; preds = %161
  %168 = getelementptr inbounds %struct.described, ptr %1, i64 0, i32 4
  %169 = load i64, ptr %168, align 8
  %170 = tail call i64 @llvm.smin.i64(i64 %165, i64 %169)
  br label %171

171:                                              ; preds = %167, %161
  %172 = phi i64 [ 1, %161 ], [ %170, %167 ]
  call void @llvm.lifetime.start.p0(i64 88, ptr nonnull %4) #10
  %173 = load ptr, ptr %1, align 8
  store ptr %173, ptr %4, align 8
  %174 = getelementptr inbounds %struct.job, ptr %4, i64 0, i32 1
  store ptr %3, ptr %174, align 8
  %175 = getelementptr inbounds %struct.job, ptr %4, i64 0, i32 2
  %176 = load i64, ptr %27, align 8
  store i64 %176, ptr %175, align 8
  %177 = getelementptr inbounds %struct.job, ptr %4, i64 0, i32 3
  %178 = getelementptr inbounds %struct.job, ptr %4, i64 0, i32 7
  call void @llvm.memset.p0.i64(ptr noundef nonnull align 8 dereferenceable(32) %177, i8 0, i64 32, i1 false)
  store i64 %51, ptr %178, align 8
  %179 = getelementptr inbounds %struct.job, ptr %4, i64 0, i32 8
  store i64 1, ptr %179, align 8
  %180 = getelementptr inbounds %struct.job, ptr %4, i64 0, i32 9
  %181 = getelementptr inbounds %struct.described, ptr %1, i64 0, i32 2
  %182 = load i64, ptr %181, align 8
  store i64 %182, ptr %180, align 8
  %183 = getelementptr inbounds %struct.job, ptr %4, i64 0, i32 10
  store i64 0, ptr %183, align 8
  call void @run_job(ptr noundef nonnull %4, i64 noundef %172)
  %184 = load atomic i64, ptr %183 seq_cst, align 8
  %185 = icmp eq i64 %184, 0
  br i1 %185, label %245, label %186

186:                                              ; preds = %171
  %187 = load i64, ptr %27, align 8
  %188 = add nsw i64 %187, -1
  %189 = icmp sgt i64 %51, 0
  br i1 %189, label %190, label %245

190:                                              ; preds = %186
  %191 = icmp sgt i64 %187, 0
  %192 = getelementptr inbounds %struct.described, ptr %1, i64 0, i32 7
  %193 = getelementptr inbounds %struct.row, ptr %3, i64 %188
  %194 = getelementptr inbounds %struct.row, ptr %3, i64 %188, i32 1
  br label %195

195:                                              ; preds = %242, %190
  %196 = phi i64 [ 0, %190 ], [ %243, %242 ]
  br i1 %191, label %197, label %242

197:                                              ; preds = %195
  %198 = load ptr, ptr %45, align 8
  br label %201

199:                                              ; preds = %213
  %200 = icmp eq i32 %214, 0
  br i1 %200, label %234, label %242

201:                                              ; preds = %213, %197
  %202 = phi i64 [ 0, %197 ], [ %215, %213 ]
  %203 = phi i32 [ 1, %197 ], [ %214, %213 ]
  %204 = getelementptr inbounds %struct.row, ptr %3, i64 %202
  %205 = load ptr, ptr %204, align 16
  %206 = getelementptr inbounds %struct.row, ptr %3, i64 %202, i32 1
  %207 = load i64, ptr %206, align 8
  %208 = mul nsw i64 %207, %196
  %209 = getelementptr inbounds i8, ptr %205, i64 %208
  %210 = getelementptr inbounds i64, ptr %198, i64 %202
  %211 = load i64, ptr %210, align 8
  %212 = icmp sgt i64 %211, 0
  br i1 %212, label %217, label %213

213:                                              ; preds = %229, %201
  %214 = phi i32 [ %203, %201 ], [ %231, %229 ]
  %215 = add nuw nsw i64 %202, 1
  %216 = icmp eq i64 %215, %187
  br i1 %216, label %199, label %201, !llvm.loop !25

217:                                              ; preds = %201, %229
  %218 = phi i64 [ %232, %229 ], [ 0, %201 ]
  %219 = phi i32 [ %231, %229 ], [ %203, %201 ]
  %220 = icmp eq i32 %219, 0
  br i1 %220, label %229, label %221

221:                                              ; preds = %217
  %222 = getelementptr inbounds double, ptr %209, i64 %218
  %223 = load double, ptr %222, align 8
  %224 = call double @llvm.fabs.f64(double %223)
  %225 = load ptr, ptr %192, align 8
  %226 = getelementptr inbounds double, ptr %225, i64 %202
  %227 = load double, ptr %226, align 8
  %228 = fcmp ole double %224, %227
  br label %229

229:                                              ; preds = %221, %217
  %230 = phi i1 [ false, %217 ], [ %228, %221 ]
  %231 = zext i1 %230 to i32
  %232 = add nuw nsw i64 %218, 1
  %233 = icmp eq i64 %232, %211
  br i1 %233, label %213, label %217, !llvm.loop !26

234:                                              ; preds = %199
  %235 = load ptr, ptr %193, align 16
  %236 = load i64, ptr %194, align 8
  %237 = mul nsw i64 %236, %196
  %238 = getelementptr inbounds i8, ptr %235, i64 %237
  %239 = getelementptr inbounds i64, ptr %198, i64 %188
  %240 = load i64, ptr %239, align 8
  %241 = shl i64 %240, 3
  call void @llvm.memset.p0.i64(ptr align 1 %238, i8 -1, i64 %241, i1 false)
  br label %242

242:                                              ; preds = %234, %199, %195
  %243 = add nuw nsw i64 %196, 1
  %244 = icmp eq i64 %243, %51
  br i1 %244, label %245, label %195, !llvm.loop !27

245:                                              ; preds = %242, %186, %171
  br i1 %56, label %246, label %258

246:                                              ; preds = %245
  %247 = load ptr, ptr %66, align 8
  %248 = icmp sgt i64 %44, 0
  br i1 %248, label %250, label %249

249:                                              ; preds = %250, %246
  call void @free(ptr noundef %162) #10
  br label %258

250:                                              ; preds = %246, %250
  %251 = phi i64 [ %256, %250 ], [ 0, %246 ]
  %252 = getelementptr inbounds double, ptr %162, i64 %251
  %253 = load double, ptr %252, align 8
  %254 = fptrunc double %253 to float
  %255 = getelementptr inbounds float, ptr %247, i64 %251
  store float %254, ptr %255, align 4
  %256 = add nuw nsw i64 %251, 1
  %257 = icmp eq i64 %256, %44
  br i1 %257, label %249, label %250, !llvm.loop !28

258:                                              ; preds = %249, %245
  call void @llvm.lifetime.end.p0(i64 88, ptr nonnull %4) #10
  br label %259

259:                                              ; preds = %258, %112
  call void @llvm.lifetime.end.p0(i64 1024, ptr nonnull %3) #10
  br label %260

260:                                              ; preds = %43, %259, %50, %12
  ret ptr null
}

; Function Attrs: inaccessiblememonly mustprogress nofree nounwind willreturn allockind("alloc,uninitialized") allocsize(0)
declare dso_local noalias noundef ptr @malloc(i64 noundef) local_unnamed_addr #5

; Function Attrs: argmemonly mustprogress nocallback nofree nounwind willreturn writeonly
declare void @llvm.memset.p0.i64(ptr nocapture writeonly, i8, i64, i1 immarg) #6

; Function Attrs: inaccessiblemem_or_argmemonly mustprogress nounwind willreturn allockind("free")
declare dso_local void @free(ptr nocapture noundef) local_unnamed_addr #7

; Function Attrs: mustprogress nocallback nofree nosync nounwind readnone speculatable willreturn
declare double @llvm.fabs.f64(double) #8

; Function Attrs: nocallback nofree nosync nounwind readnone speculatable willreturn
declare i64 @llvm.smin.i64(i64, i64) #9

attributes #0 = { nounwind }
attributes #1 = { argmemonly mustprogress nocallback nofree nosync nounwind willreturn }
attributes #2 = { argmemonly mustprogress nocallback nofree nounwind willreturn }
attributes #3 = { nounwind }
attributes #4 = { nounwind }
attributes #5 = { inaccessiblememonly mustprogress nofree nounwind willreturn }
attributes #6 = { argmemonly mustprogress nocallback nofree nounwind willreturn writeonly }
attributes #7 = { inaccessiblemem_or_argmemonly mustprogress nounwind willreturn }
attributes #8 = { mustprogress nocallback nofree nosync nounwind readnone speculatable willreturn }
attributes #9 = { nocallback nofree nosync nounwind readnone speculatable willreturn }
attributes #10 = { nounwind }
attributes #11 = { nounwind }

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
!13 = distinct !{!13, !3}
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
!24 = distinct !{!24, !2, !3}
!25 = distinct !{!25, !2, !3}
!26 = distinct !{!26, !2, !3}
!27 = distinct !{!27, !2, !3}
!28 = distinct !{!28, !2, !3}
