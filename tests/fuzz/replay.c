/* Stands in for libFuzzer: runs every file of the folders given, in order of their names, and says how many they were. */
#include <dirent.h>
#include <errno.h>
#include <string.h>

#include "fuzz.h"

static int visible(const struct dirent *entry) { return entry->d_name[0] != '.'; }

static void replay(const char *folder, const char *name) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END)) {
        fprintf(stderr, "%s: %s\n", path, strerror(errno));
        exit(1);
    }
    size_t size = (size_t)ftell(file);
    rewind(file);
    uint8_t *data = malloc(size ? size : 1); /* exactly as long as the input, so that reading past it is seen */
    if (!data || fread(data, 1, size, file) != size) exit(1);
    fclose(file);
    fprintf(stderr, "%s\n", name);
    LLVMFuzzerTestOneInput(data, size);
    free(data);
}

int main(int argc, char **argv) {
    int total = 0;
    for (int i = 1; i < argc; i++) {
        struct dirent **entry;
        int count = scandir(argv[i], &entry, visible, alphasort);
        if (count < 0) {
            fprintf(stderr, "%s: %s\n", argv[i], strerror(errno));
            return 1;
        }
        for (int k = 0; k < count; k++) {
            replay(argv[i], entry[k]->d_name);
            free(entry[k]);
        }
        free(entry);
        total += count;
    }
    fprintf(stderr, "%d inputs\n", total);
    return total ? 0 : 1; /* an empty corpus would test nothing */
}
