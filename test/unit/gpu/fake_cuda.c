/* A driver that records calls and runs nothing. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

char record[1 << 16];
char fails[64];       /* name of the function that fails */
int failure = 719;    /* its status */
uint64_t host_begin;  /* addresses from here on are not of a device */

#define NOTE(...) snprintf(record + strlen(record), sizeof record - strlen(record), __VA_ARGS__)
#define CHECK(name) if (!strcmp(fails, name)) return failure

int cuInit(unsigned flags) { CHECK("cuInit"); NOTE("cuInit %u\n", flags); return 0; }
int cuGetErrorName(int status, const char **text)
{ if (status != 719) return 1; *text = "CUDA_ERROR_LAUNCH_FAILED"; return 0; }
int cuGetErrorString(int status, const char **text)
{ if (status != 719) return 1; *text = "unspecified launch failure"; return 0; }
int cuDeviceGetCount(int *count) { CHECK("cuDeviceGetCount"); *count = 2; return 0; }
int cuDeviceGet(int *device, int k) { CHECK("cuDeviceGet"); *device = k; return 0; }
int cuDeviceGetName(char *text, int size, int device)
{ snprintf(text, size, "Fake %d", device); return 0; }
int cuDevicePrimaryCtxRetain(void **context, int device)
{ CHECK("cuDevicePrimaryCtxRetain"); NOTE("retain %d\n", device);
  *context = (void *)(uintptr_t)(0x100 + device); return 0; }
int cuCtxPushCurrent_v2(void *context) { NOTE("enter %p\n", context); return 0; }
int cuCtxPopCurrent_v2(void **context) { *context = 0; NOTE("leave\n"); return 0; }
int cuPointerGetAttribute(void *data, int attribute, uint64_t pointer)
{ CHECK("cuPointerGetAttribute"); if (attribute != 9 || pointer >= host_begin) return 1;
  *(int *)data = pointer >= 0x1000000 ? 1 : 0; return 0; }
int cuMemAlloc_v2(uint64_t *pointer, size_t size)
{ CHECK("cuMemAlloc_v2"); NOTE("allocate %zu\n", size); *pointer = 0x900000; return 0; }
int cuMemFree_v2(uint64_t pointer) { NOTE("free %#lx\n", pointer); return 0; }
int cuMemcpyHtoD_v2(uint64_t to, const void *from, size_t size) { return 0; }
int cuMemcpyDtoH_v2(void *to, uint64_t from, size_t size) { return 0; }
int cuModuleLoadDataEx(void **module, const char *text, unsigned count, int *options,
                       void **values)
{ if (!strcmp(fails, "cuModuleLoadDataEx") && count == 2 && options[0] == 5 && options[1] == 6)
    snprintf(values[0], (size_t)values[1], "ptxas fatal: line 7");
  CHECK("cuModuleLoadDataEx"); NOTE("load %.8s\n", strstr(text, ".version")); *module = (void *)0x200; return 0; }
int cuModuleGetFunction(void **function, void *module, const char *name)
{ CHECK("cuModuleGetFunction"); NOTE("function %p %s\n", module, name);
  *function = (void *)0x300; return 0; }
int cuLaunchKernel(void *function, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by,
                   unsigned bz, unsigned shared, void *stream, void **values, void **extra)
{ CHECK("cuLaunchKernel");
  NOTE("launch %p grid %u %u %u block %u %u %u shared %u stream %p extra %p values", function, gx,
       gy, gz, bx, by, bz, shared, stream, (void *)extra);
  for (int k = 0; k < 13; k++) NOTE(" %ld", *(int64_t *)values[k]);
  for (int k = 13; k < 16; k++) NOTE(" %g", *(double *)values[k]);
  NOTE("\n"); return 0; }
int cuStreamSynchronize(void *stream)
{ CHECK("cuStreamSynchronize"); NOTE("synchronize %p\n", stream); return 0; }
int cuEventCreate(void **event, unsigned flags) { return 0; }
int cuEventRecord(void *event, void *stream) { return 0; }
int cuEventSynchronize(void *event) { return 0; }
int cuEventElapsedTime(float *ms, void *a, void *b) { *ms = 1; return 0; }
int cuEventDestroy_v2(void *event) { return 0; }
