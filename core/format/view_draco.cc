#include "format/view_draco.h"

#include <cstring>
#include <exception>
#include <memory>
#include <new>

#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

namespace {

using draco::AttributeValueIndex;
using draco::GeometryAttribute;
using draco::PointIndex;

enum { POSITIONS, IDS };

void set_attribute(draco::PointCloud *cloud, int unique_id, const bw_draco_geometry *g) {
    const bool ids = unique_id == IDS;
    const int components = ids ? g->ids : 3;
    const size_t entries = ids ? g->id_count : g->position_count;
    GeometryAttribute type;
    type.Init(ids ? GeometryAttribute::GENERIC : GeometryAttribute::POSITION, nullptr,
              static_cast<int8_t>(components), draco::DT_INT32, false, 4 * components, 0);
    const int at = cloud->AddAttribute(type, false, static_cast<uint32_t>(entries));
    draco::PointAttribute *attribute = cloud->attribute(at);
    attribute->set_unique_id(static_cast<uint32_t>(unique_id));
    for (size_t i = 0; i < entries; i++)
        attribute->SetAttributeValue(AttributeValueIndex(static_cast<uint32_t>(i)),
                                     ids ? g->id[i] : g->position[i]);
    for (size_t i = 0; i < g->point_count; i++)
        attribute->SetPointMapEntry(PointIndex(static_cast<uint32_t>(i)),
                                    AttributeValueIndex(static_cast<uint32_t>(g->point[i][unique_id])));
    std::unique_ptr<draco::AttributeMetadata> name(new draco::AttributeMetadata());
    name->AddEntryString("name", ids ? "ids" : "position");
    cloud->AddAttributeMetadata(at, std::move(name));
}

void fill(draco::PointCloud *cloud, const bw_draco_geometry *g) {
    cloud->set_num_points(static_cast<uint32_t>(g->point_count));
    set_attribute(cloud, POSITIONS, g);
    set_attribute(cloud, IDS, g);
}

draco::Status encode(const bw_draco_geometry *g, draco::EncoderBuffer *out) {
    enum { SPEED = 5 }; /* parallelogram prediction; the slower ones save little on cut meshes */
    if (g->face_count) {
        draco::Mesh mesh;
        fill(&mesh, g);
        mesh.SetNumFaces(g->face_count);
        for (size_t i = 0; i < g->face_count; i++) {
            draco::Mesh::Face face;
            for (int k = 0; k < 3; k++) face[k] = PointIndex(static_cast<uint32_t>(g->face[i][k]));
            mesh.SetFace(draco::FaceIndex(static_cast<uint32_t>(i)), face);
        }
        draco::ExpertEncoder encoder(mesh);
        encoder.SetSpeedOptions(SPEED, SPEED);
        encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
        return encoder.EncodeToBuffer(out);
    }
    draco::PointCloud cloud;
    fill(&cloud, g);
    draco::ExpertEncoder encoder(cloud);
    encoder.SetSpeedOptions(SPEED, SPEED);
    encoder.SetEncodingMethod(draco::POINT_CLOUD_SEQUENTIAL_ENCODING);
    return encoder.EncodeToBuffer(out);
}

/* Takes the room for a geometry in which every point has entries of its own. */
bw_status take_room(bw_context *ctx, bw_draco_geometry *g) {
    g->position_count = g->id_count = g->point_count;
    g->position = static_cast<int32_t(*)[3]>(bw_alloc(ctx, g->point_count, sizeof *g->position));
    g->id = static_cast<int32_t(*)[BW_DRACO_IDS]>(bw_alloc(ctx, g->point_count, sizeof *g->id));
    g->point = static_cast<int32_t(*)[2]>(bw_alloc(ctx, g->point_count, sizeof *g->point));
    g->face = static_cast<int32_t(*)[3]>(bw_alloc(ctx, g->face_count, sizeof *g->face));
    return g->position && g->id && g->point && g->face ? BW_OK : ctx->error.status;
}

bw_status read_cloud(bw_context *ctx, const draco::PointCloud &cloud, const draco::Mesh *mesh,
                     bw_draco_geometry *g) {
    const draco::PointAttribute *position = cloud.GetAttributeByUniqueId(POSITIONS);
    const draco::PointAttribute *id = cloud.GetAttributeByUniqueId(IDS);
    if (!position || !id || position->num_components() != 3 || id->num_components() > BW_DRACO_IDS)
        return bw_fail(ctx, BW_E_VERSION, "the Draco stream does not hold positions and ids");
    g->point_count = cloud.num_points();
    g->face_count = mesh ? mesh->num_faces() : 0;
    g->ids = id->num_components();
    bw_status status = take_room(ctx, g);
    if (status != BW_OK) return status;
    for (uint32_t i = 0; i < cloud.num_points(); i++) {
        position->GetMappedValue(PointIndex(i), g->position[i]);
        id->GetMappedValue(PointIndex(i), g->id[i]);
        g->point[i][POSITIONS] = g->point[i][IDS] = static_cast<int32_t>(i);
    }
    for (uint32_t i = 0; i < g->face_count; i++)
        for (int k = 0; k < 3; k++)
            g->face[i][k] = static_cast<int32_t>(mesh->face(draco::FaceIndex(i))[k].value());
    return BW_OK;
}

bw_status decode(bw_context *ctx, const uint8_t *bytes, size_t length, bw_draco_geometry *g) {
    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char *>(bytes), length);
    const auto type = draco::Decoder::GetEncodedGeometryType(&buffer);
    draco::Decoder decoder;
    if (type.ok() && type.value() == draco::TRIANGULAR_MESH) {
        auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
        if (mesh.ok()) return read_cloud(ctx, *mesh.value(), mesh.value().get(), g);
    } else if (type.ok()) {
        auto cloud = decoder.DecodePointCloudFromBuffer(&buffer);
        if (cloud.ok()) return read_cloud(ctx, *cloud.value(), nullptr, g);
    }
    return bw_fail(ctx, BW_E_VERSION, "the bytes are no Draco stream");
}

} // namespace

extern "C" void bw_draco_geometry_clear(bw_context *ctx, bw_draco_geometry *g) {
    bw_free(ctx, g->position), bw_free(ctx, g->id), bw_free(ctx, g->point), bw_free(ctx, g->face);
    std::memset(g, 0, sizeof *g);
}

extern "C" bw_status bw_draco_encode(bw_context *ctx, const bw_draco_geometry *g, uint8_t **bytes,
                                     size_t *length) {
    *bytes = nullptr;
    *length = 0;
    try {
        draco::EncoderBuffer out;
        const draco::Status status = encode(g, &out);
        if (!status.ok())
            return bw_fail(ctx, BW_E_ALGORITHM, "Draco cannot encode the view: %s", status.error_msg());
        *bytes = static_cast<uint8_t *>(bw_alloc(ctx, out.size(), 1));
        if (!*bytes) return ctx->error.status;
        std::memcpy(*bytes, out.data(), out.size());
        *length = out.size();
        return BW_OK;
    } catch (const std::bad_alloc &) {
        return bw_fail(ctx, BW_E_MEMORY, "out of memory while Draco encodes the view");
    } catch (const std::exception &e) {
        return bw_fail(ctx, BW_E_ALGORITHM, "Draco cannot encode the view: %s", e.what());
    } catch (...) {
        return bw_fail(ctx, BW_E_ALGORITHM, "Draco cannot encode the view");
    }
}

extern "C" bw_status bw_draco_decode(bw_context *ctx, const uint8_t *bytes, size_t length,
                                     bw_draco_geometry *g) {
    std::memset(g, 0, sizeof *g);
    try {
        return decode(ctx, bytes, length, g);
    } catch (const std::bad_alloc &) {
        return bw_fail(ctx, BW_E_MEMORY, "out of memory while Draco decodes");
    } catch (...) {
        return bw_fail(ctx, BW_E_VERSION, "the bytes are no Draco stream");
    }
}
