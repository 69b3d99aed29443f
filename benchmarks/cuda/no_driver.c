/* A libcuda.so without a GPU: device memory is ordinary memory, nothing is launched, and every module's PTX is written to a file in
   $PTX_FOLDER. It lets Taichi compile its kernels for CUDA where there is no driver. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int modules = 0;
static int handle = 1;

int cuInit(unsigned flags) { return 0; }
int cuDriverGetVersion(int *version) { *version = 12040; return 0; }
int cuDeviceGetCount(int *count) { *count = 1; return 0; }
int cuDeviceGet(int *device, int ordinal) { *device = 0; return 0; }
int cuDeviceGetName(char *name, int length, int device) { snprintf(name, length, "none"); return 0; }
int cuDeviceGetAttribute(int *value, unsigned attribute, int device) {
    switch (attribute) {
    case 75: *value = 8; break;       /* compute capability 8.0 */
    case 16: *value = 100; break;     /* multiprocessors */
    case 106: *value = 16; break;     /* blocks of each */
    case 39: *value = 2048; break;    /* threads of each */
    case 97: *value = 98304; break;   /* shared memory of a block */
    default: *value = 0;
    }
    return 0;
}
int cuGetErrorName(int error, const char **text) { *text = "error"; return 0; }
int cuGetErrorString(int error, const char **text) { *text = "error"; return 0; }
int cuDevicePrimaryCtxRetain(void **context, int device) { *context = &handle; return 0; }
int cuCtxCreate_v2(void **context, unsigned flags, int device) { *context = &handle; return 0; }
int cuCtxGetCurrent(void **context) { *context = &handle; return 0; }
int cuCtxSetCurrent(void *context) { return 0; }
int cuCtxSetLimit(int limit, size_t value) { return 0; }
int cuMemGetInfo_v2(size_t *free_bytes, size_t *total) { *free_bytes = *total = (size_t)4 << 30; return 0; }
int cuMemAlloc_v2(void **p, size_t size) { *p = calloc(1, size); return *p ? 0 : 2; }
int cuMemAllocManaged(void **p, size_t size, unsigned flags) { return cuMemAlloc_v2(p, size); }
int cuMemAllocAsync(void **p, size_t size, void *stream) { return cuMemAlloc_v2(p, size); }
int cuMemFree_v2(void *p) { free(p); return 0; }
int cuMemFreeAsync(void *p, void *stream) { free(p); return 0; }
int cuMemcpyHtoD_v2(void *to, const void *from, size_t size) { memcpy(to, from, size); return 0; }
int cuMemcpyDtoH_v2(void *to, const void *from, size_t size) { memcpy(to, from, size); return 0; }
int cuMemcpyDtoD_v2(void *to, const void *from, size_t size) { memcpy(to, from, size); return 0; }
int cuMemcpyHtoDAsync_v2(void *to, const void *from, size_t size, void *stream) { memcpy(to, from, size); return 0; }
int cuMemcpyDtoHAsync_v2(void *to, const void *from, size_t size, void *stream) { memcpy(to, from, size); return 0; }
int cuMemsetD8_v2(void *p, unsigned char value, size_t count) { memset(p, value, count); return 0; }
int cuMemsetD32_v2(void *p, unsigned value, size_t count) { for (size_t i = 0; i < count; i++) ((unsigned *)p)[i] = value; return 0; }
int cuModuleLoadDataEx(void **module, const void *image, unsigned options, void *names, void *values) {
    char path[4096];
    snprintf(path, sizeof path, "%s/module_%04d.ptx", getenv("PTX_FOLDER"), modules++);
    FILE *file = fopen(path, "w");
    if (!file) return 1;
    fputs(image, file);
    fclose(file);
    *module = &handle;
    return 0;
}
int cuModuleGetFunction(void **function, void *module, const char *name) { *function = &handle; return 0; }
int cuStreamCreate(void **stream, unsigned flags) { *stream = &handle; return 0; }
int cuEventCreate(void **event, unsigned flags) { *event = &handle; return 0; }
int cuEventElapsedTime(float *ms, void *a, void *b) { *ms = 0; return 0; }
int cuOccupancyMaxActiveBlocksPerMultiprocessor(int *blocks, void *f, int size, size_t shared) { *blocks = 1; return 0; }
int cuPointerGetAttribute(unsigned *value, int attribute, void *p) { *value = 2; return 0; }
int cuDeviceGetDefaultMemPool(void **pool, int device) { *pool = &handle; return 0; }
int cuFuncGetAttribute(int *value, int attribute, void *f) { *value = 0; return 0; }
#define NOTHING(name) int name(void) { return 0; }
NOTHING(cuMemAdvise) NOTHING(cuMemPoolSetAttribute) NOTHING(cuStreamSynchronize) NOTHING(cuEventRecord) NOTHING(cuEventDestroy)
NOTHING(cuEventSynchronize) NOTHING(cuLaunchKernel) NOTHING(cuFuncSetAttribute) NOTHING(cuImportExternalMemory)
NOTHING(cuImportExternalSemaphore) NOTHING(cuExternalMemoryGetMappedBuffer) NOTHING(cuExternalMemoryGetMappedMipmappedArray)
NOTHING(cuMipmappedArrayGetLevel) NOTHING(cuSignalExternalSemaphoresAsync) NOTHING(cuWaitExternalSemaphoresAsync)
NOTHING(cuSurfObjectCreate) NOTHING(cuStreamDestroy_v2) NOTHING(cuModuleUnload) NOTHING(cuCtxDestroy_v2)
NOTHING(cuMemHostRegister_v2) NOTHING(cuMemHostUnregister) NOTHING(cuEventDestroy_v2) NOTHING(cuEventElapsedTime_v2)
