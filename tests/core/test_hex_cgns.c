/* CGNS files, read back by the CGNS library (format/hex_write.h): what a structured solver relies on.
 *
 * VTK and cgnscheck judge them in test_hex_readers.c.
 */
#include <cgnslib.h>
#include <stdio.h>
#include <unistd.h>

#include "core/hex_kit.h"
#include "format/hex_write.h"

typedef struct {
    char name[33];
    cgsize_t size[9];
    double *xyz[3];
    size_t sides, covered; /* quads on its outside, and those of them in links and conditions */
} zone;

typedef struct {
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_hex_skin skin;
    int file, zones;
    zone *zone; /* from 1 */
} job;

static void begin(job *j, int sample) {
    bw_context_init(&j->ctx);
    hex_kit_sample(&j->ctx, sample, &j->mesh);
    kit_expect_ok(&j->ctx, bw_hex_skin_init(&j->ctx, &j->mesh, &j->skin));
}

static void read_zone(job *j, int z) {
    static const char *const names[] = {"CoordinateX", "CoordinateY", "CoordinateZ"};
    zone *o = &j->zone[z];
    CGNS_ENUMT(ZoneType_t) type;
    assert_int_equal(cg_zone_type(j->file, 1, z, &type), CG_OK);
    assert_int_equal(type, CGNS_ENUMV(Structured));
    assert_int_equal(cg_zone_read(j->file, 1, z, o->name, o->size), CG_OK);
    for (int k = 0; k < 3; k++) {
        cgsize_t low[3] = {1, 1, 1};
        assert_int_equal(o->size[3 + k], o->size[k] - 1);
        o->xyz[k] = calloc((size_t)(o->size[0] * o->size[1] * o->size[2]), sizeof(double));
        assert_int_equal(cg_coord_read(j->file, 1, z, names[k], CGNS_ENUMV(RealDouble), low, o->size, o->xyz[k]), CG_OK);
    }
    size_t n[3] = {(size_t)o->size[3], (size_t)o->size[4], (size_t)o->size[5]};
    o->sides = 2 * (n[0] * n[1] + n[1] * n[2] + n[2] * n[0]);
}

static void open_written(job *j, const char *path) {
    assert_int_equal(cg_open(path, CG_MODE_READ, &j->file), CG_OK);
    assert_int_equal(cg_nzones(j->file, 1, &j->zones), CG_OK);
    j->zone = calloc((size_t)j->zones + 1, sizeof *j->zone);
}

static void end(job *j) {
    for (int z = 1; z <= j->zones; z++)
        for (int k = 0; k < 3; k++) free(j->zone[z].xyz[k]);
    free(j->zone);
    cg_close(j->file);
    bw_hex_skin_clear(&j->ctx, &j->skin);
    bw_hex_mesh_clear(&j->ctx, &j->mesh);
    assert_int_equal(j->ctx.memory.used, 0);
}

static size_t point(const zone *o, const cgsize_t at[3]) {
    for (int k = 0; k < 3; k++) assert_true(at[k] >= 1 && at[k] <= o->size[k]);
    return (size_t)(at[0] - 1 + o->size[0] * (at[1] - 1 + o->size[1] * (at[2] - 1)));
}

static size_t quads_of(const cgsize_t range[6]) {
    size_t quads = 1;
    int flat = 0;
    for (int k = 0; k < 3; k++) {
        assert_true(range[k] <= range[3 + k]);
        if (range[k] == range[3 + k]) flat++;
        else quads *= (size_t)(range[3 + k] - range[k]);
    }
    assert_int_equal(flat, 1);
    return quads;
}

static int zone_named(const job *j, const char *name) {
    for (int z = 1; z <= j->zones; z++)
        if (!strcmp(j->zone[z].name, name)) return z;
    fail_msg("there is no zone %s", name);
    return 0;
}

/* Point by point, by the rule of the standard: donor = T (point - begin) + donor begin. */
static size_t check_link(job *j, int z, int i) {
    char name[33], donor[33];
    cgsize_t range[6], there[6], at[3], to[3];
    int turn[3];
    assert_int_equal(cg_1to1_read(j->file, 1, z, i, name, donor, range, there, turn), CG_OK);
    const zone *here = &j->zone[z], *other = &j->zone[zone_named(j, donor)];
    size_t normal = 0;
    for (at[2] = range[2]; at[2] <= range[5]; at[2]++)
        for (at[1] = range[1]; at[1] <= range[4]; at[1]++)
            for (at[0] = range[0]; at[0] <= range[3]; at[0]++) {
                for (int k = 0; k < 3; k++) {
                    int t = abs(turn[k]) - 1;
                    to[t] = there[t] + (turn[k] < 0 ? -1 : 1) * (at[k] - range[k]);
                }
                for (int k = 0; k < 3; k++) assert_true(here->xyz[k][point(here, at)] == other->xyz[k][point(other, to)]);
            }
    for (int k = 0; k < 3; k++) {
        assert_int_equal(to[k], there[3 + k]); /* the last point is the end of both */
        if (range[k] == range[3 + k]) normal = (size_t)abs(turn[k]) - 1;
    }
    assert_true(there[normal] == 1 || there[normal] == other->size[normal]);
    return quads_of(range);
}

static size_t check_condition(job *j, int z, int i) {
    char name[33];
    cgsize_t range[6], count, list_size;
    CGNS_ENUMT(BCType_t) type;
    CGNS_ENUMT(PointSetType_t) set;
    CGNS_ENUMT(DataType_t) data;
    int normal[3], sets;
    assert_int_equal(cg_boco_info(j->file, 1, z, i, name, &type, &set, &count, normal, &list_size, &data, &sets), CG_OK);
    assert_int_equal(type, CGNS_ENUMV(BCWall));
    assert_int_equal(set, CGNS_ENUMV(PointRange));
    assert_int_equal(cg_boco_read(j->file, 1, z, i, range, NULL), CG_OK);
    assert_true(!strncmp(name, "Surface_", 8));
    return quads_of(range);
}

static void links_and_conditions_cover_all_sides_of_all_zones(void **state) {
    (void)state;
    for (int sample = 0; sample < HEX_KIT_COUNT; sample++) {
        job j = {0};
        begin(&j, sample);
        const char *path = kit_temp_path("%s.cgns", hex_kit_names[sample]);
        kit_expect_ok(&j.ctx, bw_hex_write_cgns(&j.ctx, &j.mesh, &j.skin, path, NULL));
        open_written(&j, path);
        size_t walls = 0, hexes = 0;
        int links = 0, conditions = 0;
        for (int z = 1; z <= j.zones; z++) read_zone(&j, z);
        for (int z = 1, n; z <= j.zones; z++) {
            zone *o = &j.zone[z];
            assert_int_equal(cg_n1to1(j.file, 1, z, &n), CG_OK);
            for (int i = 1; i <= n; i++) o->covered += check_link(&j, z, i);
            links += n;
            assert_int_equal(cg_nbocos(j.file, 1, z, &n), CG_OK);
            for (int i = 1; i <= n; i++) {
                size_t quads = check_condition(&j, z, i);
                walls += quads, o->covered += quads;
            }
            conditions += n;
            assert_int_equal(o->covered, o->sides);
            hexes += (size_t)o->size[3] * (size_t)o->size[4] * (size_t)o->size[5];
        }
        assert_int_equal(walls, j.skin.quad_count);
        assert_int_equal(hexes, j.mesh.hex_count);
        printf("%s: %d zones, %d links, %d conditions\n", hex_kit_names[sample], j.zones, links, conditions);
        if (sample == HEX_KIT_TEE) assert_int_equal(links, 2 * 3); /* one block on two: no more links than pairs */
        if (sample == HEX_KIT_RING) assert_int_equal(links, 2);    /* it meets itself */
        end(&j);
    }
}

static void a_mesh_without_all_blocks_is_one_unstructured_zone(void **state) {
    (void)state;
    job j = {0};
    begin(&j, HEX_KIT_GRID);
    j.mesh.block[0] = BW_NONE;
    const char *path = kit_temp_path("unstructured.cgns");
    kit_expect_ok(&j.ctx, bw_hex_write_cgns(&j.ctx, &j.mesh, &j.skin, path, NULL));
    open_written(&j, path);
    char name[33];
    cgsize_t size[9], from, to;
    CGNS_ENUMT(ZoneType_t) type;
    CGNS_ENUMT(ElementType_t) element;
    int sections, conditions, boundary, parents;
    assert_int_equal(j.zones, 1);
    cg_zone_type(j.file, 1, 1, &type);
    cg_zone_read(j.file, 1, 1, name, size);
    cg_nsections(j.file, 1, 1, &sections);
    cg_nbocos(j.file, 1, 1, &conditions);
    cg_section_read(j.file, 1, 1, 1, name, &element, &from, &to, &boundary, &parents);
    assert_int_equal(type, CGNS_ENUMV(Unstructured));
    assert_int_equal(element, CGNS_ENUMV(HEXA_8));
    assert_int_equal(to - from + 1, j.mesh.hex_count);
    assert_int_equal(size[0], j.mesh.vertex_count);
    assert_int_equal(sections, 1 + j.skin.surface_count);
    assert_int_equal(conditions, j.skin.surface_count);
    end(&j);
}

static void the_same_mesh_gives_the_same_bytes_at_any_time(void **state) {
    (void)state;
    char *bytes[2];
    size_t size[2];
    for (int i = 0; i < 2; i++) {
        job j = {0};
        uint64_t told;
        begin(&j, HEX_KIT_FIVE);
        const char *path = kit_temp_path("same-%d.cgns", i);
        kit_expect_ok(&j.ctx, bw_hex_write_cgns(&j.ctx, &j.mesh, &j.skin, path, &told));
        bytes[i] = kit_read_file(path, &size[i]);
        assert_int_equal(told, size[i]);
        open_written(&j, path);
        j.zones = 0;
        end(&j);
        if (i == 0) sleep(1); /* the library's clock has seconds */
    }
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    free(bytes[0]), free(bytes[1]);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(links_and_conditions_cover_all_sides_of_all_zones),
    cmocka_unit_test(a_mesh_without_all_blocks_is_one_unstructured_zone),
    cmocka_unit_test(the_same_mesh_gives_the_same_bytes_at_any_time),
};
KIT_MAIN(tests)
