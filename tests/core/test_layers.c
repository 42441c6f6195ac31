/* Who may include whom (core/README.md): base <- exact <- solve, mesh <- complex <- quantize <- igm <- hex <- tspline <- format, stage <- pipeline.
 *
 * Read from the #include lines of all sources. A folder may include itself and the folders before it; solve and mesh, and
 * format and stage, stand side by side. No stage includes another. The daemon includes nothing of core but base/status; only the
 * worker joins the two. Each rule is also tried on an include that breaks it, so that it cannot pass by seeing nothing.
 */
#include "kit/kit.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    const char *folder, *may; /* folders it may include besides itself, each between blanks */
} layer;

static const layer layers[] = {
    {"base", " "},
    {"exact", " base "},
    {"solve", " base exact "},
    {"mesh", " base exact "},
    {"complex", " base exact solve mesh "},
    {"quantize", " base exact solve mesh complex "},
    {"igm", " base exact solve mesh complex quantize "},
    {"hex", " base exact solve mesh complex quantize igm "},
    {"explore", " base exact solve mesh complex quantize igm hex "},
    {"tspline", " base exact solve mesh complex quantize igm hex "},
    {"format", " base exact solve mesh complex quantize igm hex explore tspline "},
    {"stage", " base exact solve mesh complex quantize igm hex explore tspline format "}, /* stages read and write through format */
};

static const layer *layer_of(const char *folder, size_t length) {
    for (size_t i = 0; i < sizeof layers / sizeof *layers; i++)
        if (strlen(layers[i].folder) == length && !strncmp(layers[i].folder, folder, length)) return &layers[i];
    return NULL;
}

/* "trace" of "trace.h" and of "trace_walls.c": the stage that a file belongs to. */
static size_t stage_length(const char *file) { return strcspn(file, "_."); }

/* What is wrong with core/<folder>/<file> including "included"; NULL if nothing. */
static const char *core_fault(const char *folder, const char *file, const char *included) {
    const char *slash = strchr(included, '/');
    if (!slash) { /* beside core's folders: blockwright.h, pipeline.h; or a file of its own folder */
        if (!*folder) return NULL;
        return !strcmp(included, "blockwright.h") && !strcmp(folder, "stage") ? NULL : "only the pipeline includes files of core itself";
    }
    const layer *to = layer_of(included, (size_t)(slash - included));
    if (!to) return "no folder of core";
    if (!*folder) return NULL; /* pipeline.c, blockwright.h */
    const layer *from = layer_of(folder, strlen(folder));
    if (!from) return "a folder without a layer";
    if (from != to) {
        char word[40];
        snprintf(word, sizeof word, " %s ", to->folder);
        return strstr(from->may, word) ? NULL : "a layer above or beside it";
    }
    if (strcmp(folder, "stage")) return NULL;
    const char *other = slash + 1;
    size_t n = stage_length(file);
    return (n == stage_length(other) && !strncmp(file, other, n)) || !strcmp(other, "stage.h") ? NULL : "another stage";
}

static const char *server_fault(const char *file, const char *included) {
    const char *slash = strchr(included, '/');
    bool core = !strcmp(included, "blockwright.h") || (slash && layer_of(included, (size_t)(slash - included)));
    bool worker = !strcmp(file, "worker.c");
    if (!strcmp(file, "spawner.c") && !strcmp(included, "server/log.h")) return "the log in the spawner, which a reload of its settings does not reach";
    return !core || worker || !strcmp(included, "base/status.h") || !strcmp(included, "base/status.def") ? NULL
                                                                                            : "core in the daemon (only worker.c may)";
}

static size_t faults, includes;

/* Calls for each #include "..." of a file. */
static void check_file(const char *path, const char *folder, const char *file, bool server) {
    char *text = kit_read_file(path, NULL), *rest = text;
    for (char *line; (line = strsep(&rest, "\n"));) {
        char included[200];
        line += strspn(line, " \t");
        if (*line != '#') continue;
        line += 1 + strspn(line + 1, " \t");
        if (sscanf(line, "include \"%199[^\"]\"", included) != 1) continue;
        includes++;
        const char *fault = server ? server_fault(file, included) : core_fault(folder, file, included);
        if (!fault) continue;
        print_error("%s includes \"%s\": %s\n", path, included, fault);
        faults++;
    }
    free(text);
}

static void check_folder(const char *root, const char *folder, bool server) {
    static const char *const endings[] = {".c", ".h", ".cc", ".def"};
    char path[1024];
    snprintf(path, sizeof path, "%s/%s/%s", BW_SOURCE_DIR, root, folder);
    for (size_t e = 0; e < sizeof endings / sizeof *endings; e++) {
        size_t count;
        char **names = kit_names(path, endings[e], &count);
        for (size_t i = 0; i < count; i++) {
            char file[1400];
            snprintf(file, sizeof file, "%s/%s", path, names[i]);
            check_file(file, folder, names[i], server);
        }
        kit_names_free(names, count);
    }
}

static void core_includes_only_downwards(void **state) {
    (void)state;
    faults = includes = 0;
    check_folder("core", "", false);
    for (size_t i = 0; i < sizeof layers / sizeof *layers; i++) check_folder("core", layers[i].folder, false);
    assert_true(includes > 10);
    assert_int_equal(faults, 0);
}

static void every_folder_of_core_has_a_layer(void **state) {
    (void)state;
    DIR *dir = opendir(BW_SOURCE_DIR "/core");
    assert_non_null(dir);
    for (struct dirent *entry; (entry = readdir(dir));)
        if (entry->d_type == DT_DIR && entry->d_name[0] != '.' && !layer_of(entry->d_name, strlen(entry->d_name)))
            fail_msg("core/%s has no layer", entry->d_name);
    closedir(dir);
}

static void the_daemon_includes_nothing_of_core_but_its_statuses(void **state) {
    (void)state;
    faults = includes = 0;
    check_folder("server", "", true);
    DIR *dir = opendir(BW_SOURCE_DIR "/server");
    assert_non_null(dir);
    for (struct dirent *entry; (entry = readdir(dir));)
        if (entry->d_type == DT_DIR && entry->d_name[0] != '.') check_folder("server", entry->d_name, true);
    closedir(dir);
    assert_true(includes > 0);
    assert_int_equal(faults, 0);
}

static void includes_that_break_a_rule_are_seen(void **state) {
    (void)state;
    assert_null(core_fault("mesh", "tetmesh.c", "exact/rotation.h"));
    assert_null(core_fault("stage", "trace.c", "stage/trace.h"));
    assert_null(core_fault("stage", "trace_walls.c", "stage/trace.h"));
    assert_null(core_fault("", "pipeline.c", "stage/trace.h"));
    assert_non_null(core_fault("base", "context.c", "mesh/tetmesh.h"));
    assert_non_null(core_fault("solve", "linear.c", "mesh/tetmesh.h"));
    assert_non_null(core_fault("complex", "complex.c", "format/hexex.h"));
    assert_non_null(core_fault("quantize", "model.c", "format/state.h"));
    assert_non_null(core_fault("complex", "complex.c", "quantize/model.h"));
    assert_null(core_fault("format", "state.h", "quantize/model.h"));
    assert_non_null(core_fault("format", "hexex.c", "stage/trace.h"));
    assert_non_null(core_fault("stage", "build.c", "stage/trace.h"));
    assert_non_null(core_fault("mesh", "tetmesh.c", "blockwright.h"));
    assert_non_null(core_fault("mesh", "tetmesh.c", "server/store.h"));
    assert_null(server_fault("worker.c", "blockwright.h"));
    assert_null(server_fault("http.c", "base/status.h"));
    assert_null(server_fault("http.c", "server/store.h"));
    assert_null(server_fault("http.c", "store.h"));
    assert_non_null(server_fault("http.c", "blockwright.h"));
    assert_non_null(server_fault("http.c", "base/context.h"));
    assert_non_null(server_fault("store.c", "format/hexex.h"));
    assert_non_null(server_fault("spawner.c", "server/log.h"));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(core_includes_only_downwards),
    cmocka_unit_test(every_folder_of_core_has_a_layer),
    cmocka_unit_test(the_daemon_includes_nothing_of_core_but_its_statuses),
    cmocka_unit_test(includes_that_break_a_rule_are_seen),
};
KIT_MAIN(tests)
