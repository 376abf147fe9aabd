/* What Base's headers do not say, for clang-tidy: these end the program, those never return NULL. */
#include <stddef.h>
void cantProceed(const char *message, ...) __attribute__((noreturn));
void *callocMustSucceed(size_t count, size_t size, const char *message) __attribute__((returns_nonnull));
void *mallocMustSucceed(size_t size, const char *message) __attribute__((returns_nonnull));
