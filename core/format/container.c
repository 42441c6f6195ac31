#include "format/container.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static const char magic[8] = "bwstate\n";
enum { BYTE_ORDER_MARK = 0x01020304, PATH_ROOM = 4096 };

struct bw_container {
    bw_context *ctx;
    const char *data; /* the whole file */
    size_t size;
    bool mapped;
    const bw_container_header *header;
    const bw_container_entry *entry;
};

/* ---- checksum: XXH64 ------------------------------------------------------------------------------------------ */

static const uint64_t prime[6] = {0, 0x9e3779b185ebca87, 0xc2b2ae3d27d4eb4f, 0x165667b19e3779f9, 0x85ebca77c2b2ae63, 0x27d4eb2f165667c5};

typedef struct {
    uint64_t lane[4], total;
} checksum;

static uint64_t rotate(uint64_t x, int by) { return x << by | x >> (64 - by); }
static uint64_t mix(uint64_t lane, uint64_t word) { return rotate(lane + word * prime[2], 31) * prime[1]; }
static uint64_t load64(const void *p) {
    uint64_t word;
    memcpy(&word, p, sizeof word);
    return word;
}

static void checksum_start(checksum *c) {
    *c = (checksum){{prime[1] + prime[2], prime[2], 0, -prime[1]}, 0};
}

static void checksum_add(checksum *c, const void *data, size_t size) { /* size: a multiple of 32 */
    const char *p = data;
    uint64_t a = c->lane[0], b = c->lane[1], d = c->lane[2], e = c->lane[3];
    for (size_t i = 0; i < size; i += 32) {
        a = mix(a, load64(p + i)), b = mix(b, load64(p + i + 8));
        d = mix(d, load64(p + i + 16)), e = mix(e, load64(p + i + 24));
    }
    c->lane[0] = a, c->lane[1] = b, c->lane[2] = d, c->lane[3] = e;
    c->total += size;
}

/* `tail` holds the last total % 32 bytes. */
static uint64_t checksum_end(const checksum *c, const char *tail, size_t left) {
    uint64_t total = c->total + left, h = prime[5];
    if (c->total) {
        h = rotate(c->lane[0], 1) + rotate(c->lane[1], 7) + rotate(c->lane[2], 12) + rotate(c->lane[3], 18);
        for (int i = 0; i < 4; i++) h = (h ^ mix(0, c->lane[i])) * prime[1] + prime[4];
    }
    h += total;
    for (; left >= 8; left -= 8, tail += 8) h = rotate(h ^ mix(0, load64(tail)), 27) * prime[1] + prime[4];
    if (left >= 4) {
        uint32_t word;
        memcpy(&word, tail, 4);
        h = rotate(h ^ word * prime[1], 23) * prime[2] + prime[3];
        left -= 4, tail += 4;
    }
    for (; left; left--, tail++) h = rotate(h ^ (unsigned char)*tail * prime[5], 11) * prime[1];
    h = (h ^ h >> 33) * prime[2];
    h = (h ^ h >> 29) * prime[3];
    return h ^ h >> 32;
}

uint64_t bw_checksum(const void *data, size_t size) {
    checksum c;
    checksum_start(&c);
    size_t whole = size & ~(size_t)31;
    checksum_add(&c, data, whole);
    return checksum_end(&c, (const char *)data + whole, size - whole);
}

static uint64_t checksum_after(const bw_container_header *header, const void *rest, size_t size) {
    bw_container_header blank = *header;
    blank.checksum = 0;
    checksum c;
    checksum_start(&c);
    checksum_add(&c, &blank, sizeof blank);
    size_t whole = size & ~(size_t)31;
    checksum_add(&c, rest, whole);
    return checksum_end(&c, (const char *)rest + whole, size - whole);
}

uint64_t bw_container_checksum(const void *data, size_t size) {
    bw_container_header header;
    memcpy(&header, data, sizeof header);
    return checksum_after(&header, (const char *)data + sizeof header, size - sizeof header);
}

/* ---- names ---------------------------------------------------------------------------------------------------- */

static bool set_name(char to[BW_CONTAINER_NAME], const char *name) {
    size_t length = strnlen(name, BW_CONTAINER_NAME + 1);
    if (!length || length > BW_CONTAINER_NAME) return false;
    memset(to, 0, BW_CONTAINER_NAME);
    memcpy(to, name, length);
    return true;
}

static bool same_name(const char stored[BW_CONTAINER_NAME], const char *name) {
    char wanted[BW_CONTAINER_NAME];
    return set_name(wanted, name) && !memcmp(stored, wanted, sizeof wanted);
}

static uint64_t padding(uint64_t size) { return -size & (BW_CONTAINER_ALIGN - 1); }

/* ---- writing -------------------------------------------------------------------------------------------------- */

typedef struct {
    bw_context *ctx;
    const char *path;
    int fd;
    checksum sum;
} file;

static bw_status io_error(bw_context *ctx, const char *what, const char *path) {
    return bw_fail(ctx, BW_E_IO, "cannot %s %.200s: %s", what, path, strerror(errno));
}

static bw_status write_bytes(file *f, const void *data, size_t size) {
    const char *p = data;
    while (size) {
        ssize_t n = write(f->fd, p, size < (1u << 30) ? size : 1u << 30);
        if (n < 0 && errno != EINTR) return io_error(f->ctx, "write", f->path);
        if (n > 0) p += n, size -= (size_t)n;
    }
    return BW_OK;
}

/* Writes data and zeros up to a multiple of BW_CONTAINER_ALIGN, and takes them into the checksum. */
static bw_status write_padded(file *f, const void *data, size_t size) {
    const char *p = data;
    size_t whole = size & ~(size_t)(BW_CONTAINER_ALIGN - 1), rest = size - whole;
    char last[BW_CONTAINER_ALIGN] = {0};
    if (rest) memcpy(last, p + whole, rest);
    checksum_add(&f->sum, p, whole);
    if (rest) checksum_add(&f->sum, last, sizeof last);
    bw_status status = write_bytes(f, p, whole);
    return status == BW_OK && rest ? write_bytes(f, last, sizeof last) : status;
}

static bw_status lay_out(bw_context *ctx, bw_container_header *header, bw_container_entry *entry,
                         const bw_section *section) {
    uint64_t at = sizeof *header + (uint64_t)header->section_count * sizeof *entry;
    for (uint32_t i = 0; i < header->section_count; i++) {
        uint64_t bytes;
        entry[i] = (bw_container_entry){.elem_size = section[i].elem_size, .count = section[i].count, .offset = at};
        if (!section[i].elem_size || !set_name(entry[i].tag, section[i].tag) ||
            __builtin_mul_overflow(entry[i].elem_size, entry[i].count, &bytes) || bytes > (uint64_t)INT64_MAX / 2 - at)
            return bw_fail(ctx, BW_E_INTERNAL, "section '%.20s' cannot be written", section[i].tag);
        for (uint32_t k = 0; k < i; k++)
            if (!memcmp(entry[k].tag, entry[i].tag, BW_CONTAINER_NAME))
                return bw_fail(ctx, BW_E_INTERNAL, "section '%.20s' is there twice", section[i].tag);
        at += bytes + padding(bytes);
    }
    header->file_size = at;
    return BW_OK;
}

static bw_status write_file(file *f, bw_container_header *header, const bw_container_entry *entry, const bw_section *section) {
    checksum_start(&f->sum);
    bw_status status = write_padded(f, header, sizeof *header); /* the checksum comes in at the end */
    if (status == BW_OK) status = write_padded(f, entry, header->section_count * sizeof *entry);
    for (uint32_t i = 0; status == BW_OK && i < header->section_count; i++) {
        if ((status = bw_poll(f->ctx)) != BW_OK) break;
        status = write_padded(f, section[i].data, section[i].elem_size * section[i].count);
    }
    if (status != BW_OK) return status;
    header->checksum = checksum_end(&f->sum, NULL, 0);
    if (lseek(f->fd, 0, SEEK_SET) != 0) return io_error(f->ctx, "write", f->path);
    return write_bytes(f, header, sizeof *header);
}

static bw_status sync_folder_of(bw_context *ctx, const char *path) {
    char folder[PATH_ROOM];
    const char *slash = strrchr(path, '/');
    if (!slash) snprintf(folder, sizeof folder, ".");
    else snprintf(folder, sizeof folder, "%.*s", slash == path ? 1 : (int)(slash - path), path);
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return io_error(ctx, "open", folder);
    bw_status status = fsync(fd) ? io_error(ctx, "sync", folder) : BW_OK;
    close(fd);
    return status;
}

static bw_status write_and_rename(file *f, const char *path, bw_container_header *header, const bw_container_entry *entry,
                                  const bw_section *section, bool sync) {
    f->fd = open(f->path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (f->fd < 0) return io_error(f->ctx, "create", f->path);
    bw_status status = write_file(f, header, entry, section);
    if (status == BW_OK && sync && fdatasync(f->fd)) status = io_error(f->ctx, "sync", f->path);
    if (close(f->fd) && status == BW_OK) status = io_error(f->ctx, "close", f->path);
    if (status == BW_OK && rename(f->path, path)) status = io_error(f->ctx, "rename", f->path);
    if (status != BW_OK) {
        unlink(f->path);
        return status;
    }
    return sync ? sync_folder_of(f->ctx, path) : BW_OK;
}

bw_status bw_container_write(bw_context *ctx, const char *path, const char *stage, uint32_t stage_version,
                             const bw_section *section, size_t section_count, bool sync) {
    char part[PATH_ROOM];
    bw_container_header header = {.version = BW_CONTAINER_VERSION, .byte_order = BYTE_ORDER_MARK, .stage_version = stage_version,
                                  .section_count = (uint32_t)section_count};
    memcpy(header.magic, magic, sizeof magic);
    if (!set_name(header.stage, stage) || section_count > BW_CONTAINER_SECTIONS_MAX)
        return bw_fail(ctx, BW_E_INTERNAL, "state of stage '%.20s' with %zu sections cannot be written", stage, section_count);
    if (snprintf(part, sizeof part, "%s.part", path) >= PATH_ROOM)
        return bw_fail(ctx, BW_E_IO, "the path %.80s... is too long", path);
    bw_container_entry *entry = bw_alloc(ctx, section_count, sizeof *entry);
    if (!entry) return ctx->error.status;
    file f = {.ctx = ctx, .path = part, .fd = -1};
    bw_status status = lay_out(ctx, &header, entry, section);
    if (status == BW_OK) status = write_and_rename(&f, path, &header, entry, section, sync);
    bw_free(ctx, entry);
    return status;
}

/* ---- reading -------------------------------------------------------------------------------------------------- */

static bw_status damaged(bw_container *c, const char *what) {
    return bw_fail(c->ctx, BW_E_IO, "the state file is damaged: %s", what);
}

static bw_status check_header(bw_container *c, const char *stage, uint32_t stage_version) {
    if (c->size < sizeof *c->header) return damaged(c, "it is shorter than its header");
    const bw_container_header *h = c->header = (const void *)c->data;
    if (memcmp(h->magic, magic, sizeof magic)) return damaged(c, "it does not start as one");
    if (h->version != BW_CONTAINER_VERSION || h->byte_order != BYTE_ORDER_MARK)
        return bw_fail(c->ctx, BW_E_VERSION, "the state file has format version %u, not %d, or another byte order",
                       (unsigned)h->version, BW_CONTAINER_VERSION);
    if (h->file_size != c->size || h->reserved) return damaged(c, "its size is not the one its header states");
    if (h->section_count > BW_CONTAINER_SECTIONS_MAX || h->section_count > (c->size - sizeof *h) / sizeof *c->entry)
        return damaged(c, "its section table does not fit");
    c->entry = (const void *)(c->data + sizeof *h);
    if (bw_container_checksum(c->data, c->size) != h->checksum) return damaged(c, "its checksum is wrong");
    if (!same_name(h->stage, stage) || h->stage_version != stage_version)
        return bw_fail(c->ctx, BW_E_VERSION, "the state file was written by another stage or version than %.16s %u", stage,
                       (unsigned)stage_version);
    return BW_OK;
}

static bool tag_is_clean(const char tag[BW_CONTAINER_NAME]) { /* not empty, and zeros only at its end */
    size_t length = strnlen(tag, BW_CONTAINER_NAME);
    for (size_t i = length; i < BW_CONTAINER_NAME; i++)
        if (tag[i]) return false;
    return length > 0;
}

static bw_status check_entries(bw_container *c) {
    uint64_t at = sizeof *c->header + c->header->section_count * sizeof *c->entry;
    for (uint32_t i = 0; i < c->header->section_count; i++) {
        const bw_container_entry *e = &c->entry[i];
        uint64_t bytes;
        if (!tag_is_clean(e->tag) || e->reserved[0] || e->reserved[1] || e->reserved[2]) return damaged(c, "a section is malformed");
        if (!e->elem_size || __builtin_mul_overflow(e->elem_size, e->count, &bytes)) return damaged(c, "a section's size overflows");
        if (e->offset != at || bytes > c->size - at) return damaged(c, "a section lies outside its place");
        if (padding(bytes) > c->size - at - bytes) return damaged(c, "a section lacks its padding");
        at += bytes + padding(bytes);
        for (uint32_t k = 0; k < i; k++)
            if (!memcmp(c->entry[k].tag, e->tag, BW_CONTAINER_NAME)) return damaged(c, "a section is there twice");
    }
    return at == c->size ? BW_OK : damaged(c, "there are bytes after its last section");
}

static bw_status validate(bw_container *c, bw_status status, const char *stage, uint32_t stage_version, bw_container **result) {
    if (status == BW_OK) status = check_header(c, stage, stage_version);
    if (status == BW_OK) status = check_entries(c);
    if (status == BW_OK) *result = c;
    else bw_container_close(c);
    return status;
}

static bw_status map_file(bw_container *c, const char *path) {
    struct stat info;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return io_error(c->ctx, "open", path);
    bw_status status = BW_OK;
    if (fstat(fd, &info)) status = io_error(c->ctx, "read", path);
    else if (!S_ISREG(info.st_mode)) status = bw_fail(c->ctx, BW_E_IO, "%.200s is not a regular file", path);
    else if (info.st_size < (off_t)sizeof *c->header) status = damaged(c, "it is shorter than its header");
    else {
        void *data = mmap(NULL, (size_t)info.st_size, PROT_READ, MAP_PRIVATE, fd, 0);
        if (data == MAP_FAILED) status = io_error(c->ctx, "map", path);
        else c->data = data, c->size = (size_t)info.st_size, c->mapped = true;
    }
    close(fd);
    return status;
}

static bw_container *new_container(bw_context *ctx, bw_container **result) {
    *result = NULL;
    bw_container *c = bw_alloc(ctx, 1, sizeof *c);
    if (c) c->ctx = ctx;
    return c;
}

bw_status bw_container_open(bw_context *ctx, const char *path, const char *stage, uint32_t stage_version, bw_container **result) {
    bw_container *c = new_container(ctx, result);
    if (!c) return ctx->error.status;
    return validate(c, map_file(c, path), stage, stage_version, result);
}

bw_status bw_container_open_memory(bw_context *ctx, const void *data, size_t size, const char *stage, uint32_t stage_version,
                                   bw_container **result) {
    bw_container *c = new_container(ctx, result);
    if (!c) return ctx->error.status;
    c->data = data;
    c->size = size;
    bw_status status = (uintptr_t)data % BW_CONTAINER_ALIGN ? bw_fail(ctx, BW_E_INTERNAL, "the memory is not aligned") : BW_OK;
    return validate(c, status, stage, stage_version, result);
}

void bw_container_close(bw_container *c) {
    if (!c) return;
    if (c->mapped) munmap((void *)(uintptr_t)c->data, c->size);
    bw_free(c->ctx, c);
}

static const bw_container_entry *find(const bw_container *c, const char *tag) {
    for (uint32_t i = 0; i < c->header->section_count; i++)
        if (same_name(c->entry[i].tag, tag)) return &c->entry[i];
    return NULL;
}

bool bw_container_has(const bw_container *c, const char *tag) { return find(c, tag) != NULL; }

const void *bw_container_section(const bw_container *c, const char *tag, size_t elem_size, size_t *count) {
    const bw_container_entry *e = find(c, tag);
    *count = 0;
    if (!e || e->elem_size != elem_size) {
        bw_fail(c->ctx, BW_E_VERSION, "the state file has no section '%.16s' with elements of %zu bytes", tag, elem_size);
        return NULL;
    }
    *count = (size_t)e->count;
    return c->data + e->offset;
}

const void *bw_container_section_of(const bw_container *c, const char *tag, size_t elem_size, size_t count) {
    size_t found;
    const void *data = bw_container_section(c, tag, elem_size, &found);
    if (!data || found == count) return data;
    bw_fail(c->ctx, BW_E_IO, "section '%.16s' of the state file has %zu elements, not %zu", tag, found, count);
    return NULL;
}
