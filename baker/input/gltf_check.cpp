// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_check.h"

#include "baker/input/gltf_uri.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <utility>

namespace envbake::gltf {

namespace {

using nlohmann::json;

constexpr std::int64_t kMaxInt = std::numeric_limits<std::int32_t>::max();
constexpr std::int64_t kMaxBytes = std::int64_t{1} << 40;  // products stay below 2^63
constexpr int kByte = 5120, kUByte = 5121, kShort = 5122, kUShort = 5123, kUInt = 5125,
              kFloat = 5126;

constexpr std::array<const char*, 7> kReadExtensions{
    "EXT_meshopt_compression", "KHR_draco_mesh_compression", "KHR_materials_emissive_strength",
    "KHR_materials_ior",       "KHR_materials_specular",     "KHR_mesh_quantization",
    "KHR_texture_transform"};

/// Collects the first error and all faults. After an error the checks run on, harmlessly.
class Report {
  public:
    void refuse(const std::string& path, const std::string& why) {
        if (!error_) error_ = Error{Errc::InvalidInput, concat(path, ": ", why)};
    }
    void fault(const std::string& path, const std::string& why) {
        if (faults_.size() < kMaxFaults) faults_.push_back(concat(path, ": ", why));
    }
    bool failed() const { return error_.has_value(); }
    Expected<std::vector<std::string>> finish() && {
        if (error_) return *std::move(error_);
        return std::move(faults_);
    }

  private:
    static constexpr std::size_t kMaxFaults = 20;
    std::optional<Error> error_;
    std::vector<std::string> faults_;
};

/// A JSON object and where it stands. A getter of an absent property returns the fallback; one of
/// the wrong type or range is refused and returns the fallback too.
class Object {
  public:
    Object(Report& report, const json& value, std::string path)
        : report_(&report), value_(&value), path_(std::move(path)) {
        if (!value.is_object()) {
            refuse(concat("is of type ", value.type_name(), ", it must be an object"));
            value_ = &empty();
        }
    }

    const std::string& path() const { return path_; }
    std::string path(const std::string& key) const {
        return path_.empty() ? key : path_ + "." + key;
    }
    const json& value() const { return *value_; }
    bool has(const char* key) const { return value_->contains(key); }
    void refuse(const std::string& why) const { report_->refuse(path_, why); }
    void refuse(const std::string& key, const std::string& why) const {
        report_->refuse(path(key), why);
    }
    void fault(const std::string& key, const std::string& why) const {
        report_->fault(key.empty() ? path_ : path(key), why);
    }

    void require(const char* key) const {
        if (!has(key)) refuse(key, "missing");
    }

    std::int64_t integer(const char* key, std::int64_t low, std::int64_t high,
                         std::int64_t fallback) const {
        const json* v = find(key);
        if (!v) return fallback;
        if (!v->is_number_integer()) {
            wrong_type(key, *v, "an integer");
            return fallback;
        }
        const bool too_big = v->is_number_unsigned() &&
                             v->get<std::uint64_t>() > static_cast<std::uint64_t>(kMaxBytes);
        const std::int64_t n = too_big ? kMaxBytes + 1 : v->get<std::int64_t>();
        if (n < low || n > high) {
            refuse(key, concat(v->dump(), " is not in ", low, " .. ", high));
            return fallback;
        }
        return n;
    }

    int one_of(const char* key, std::initializer_list<int> accepted, int fallback) const {
        const auto n = static_cast<int>(integer(key, 0, kMaxInt, fallback));
        if (std::find(accepted.begin(), accepted.end(), n) != accepted.end() || n == fallback)
            return n;
        std::string list;
        for (const int a : accepted) list += concat(list.empty() ? "" : ", ", a);
        refuse(key, concat(n, " is not one of ", list));
        return fallback;
    }

    /// An index into a collection of `size` elements; -1 when absent or refused.
    int index(const char* key, std::size_t size, const char* collection) const {
        const json* v = find(key);
        return v ? index_of(*v, key, size, collection) : -1;
    }
    int index_of(const json& v, const std::string& key, std::size_t size,
                 const char* collection) const {
        if (!v.is_number_integer()) {
            wrong_type(key, v, "an index");
        } else if (v.is_number_unsigned() && v.get<std::uint64_t>() < size) {
            return static_cast<int>(v.get<std::uint64_t>());
        } else {
            refuse(key, concat(v.dump(), " is not an index into ", collection,
                               ", of which there are ", size));
        }
        return -1;
    }

    double number(const char* key, double low, double high, double fallback) const {
        const json* v = find(key);
        if (!v) return fallback;
        return number_of(*v, key, low, high) ? v->get<double>() : fallback;
    }

    std::vector<double> numbers(const char* key, std::size_t count, double low = -kHuge,
                                double high = kHuge) const {
        std::vector<double> out;
        const json* v = array(key);
        if (!v) return out;
        if (v->size() != count) {
            refuse(key, concat("has ", v->size(), " elements, it must have ", count));
            return out;
        }
        for (std::size_t i = 0; i < count; ++i) {
            if (!number_of((*v)[i], concat(key, "[", i, "]"), low, high)) return {};
            out.push_back((*v)[i].get<double>());
        }
        return out;
    }

    bool boolean(const char* key) const {
        const json* v = find(key);
        if (v && !v->is_boolean()) wrong_type(key, *v, "a boolean");
        return v && v->is_boolean() && v->get<bool>();
    }

    std::string text(const char* key) const {
        const json* v = find(key);
        if (v && !v->is_string()) wrong_type(key, *v, "a string");
        return v && v->is_string() ? v->get<std::string>() : std::string();
    }

    std::string word(const char* key, std::initializer_list<const char*> accepted,
                     const char* fallback) const {
        if (!has(key)) return fallback;
        const std::string seen = text(key);
        std::string list;
        for (const char* a : accepted) {
            if (seen == a) return seen;
            list += concat(list.empty() ? "" : ", ", a);
        }
        refuse(key, concat(shown(seen), " is not one of ", list));
        return fallback;
    }

    /// The array under `key`, or null.
    const json* array(const char* key) const {
        const json* v = find(key);
        if (v && !v->is_array()) {
            wrong_type(key, *v, "an array");
            return nullptr;
        }
        return v;
    }

    std::optional<Object> object(const char* key) const {
        const json* v = find(key);
        if (!v) return std::nullopt;
        return Object(*report_, *v, path(key));
    }

    std::optional<Object> extension(const char* name) const {
        const auto extensions = object("extensions");
        return extensions ? extensions->object(name) : std::nullopt;
    }

    /// The distinct indices in the array under `key`.
    std::vector<int> indices(const char* key, std::size_t size, const char* collection) const {
        std::vector<int> out;
        const json* v = array(key);
        if (!v) return out;
        if (v->empty()) fault(key, "is an empty array");
        std::set<int> seen;
        for (std::size_t i = 0; i < v->size(); ++i) {
            const std::string element = concat(key, "[", i, "]");
            const int n = index_of((*v)[i], element, size, collection);
            if (n >= 0 && !seen.insert(n).second) refuse(element, concat(n, " is listed twice"));
            out.push_back(n);
        }
        return out;
    }

    /// Calls visit(Object) for each element of the array under `key`.
    template <class Visit>
    void each(const char* key, Visit visit) const {
        const json* v = array(key);
        if (!v) return;
        for (std::size_t i = 0; i < v->size() && !report_->failed(); ++i)
            visit(Object(*report_, (*v)[i], concat(path(key), "[", i, "]")));
    }

  private:
    static constexpr double kHuge = std::numeric_limits<double>::max();
    static const json& empty() {
        static const json none = json::object();
        return none;
    }
    const json* find(const char* key) const {
        const auto it = value_->find(key);
        return it == value_->end() ? nullptr : &*it;
    }
    bool number_of(const json& v, const std::string& key, double low, double high) const {
        if (!v.is_number()) {
            wrong_type(key, v, "a number");
            return false;
        }
        const double n = v.get<double>();
        if (n >= low && n <= high) return true;
        refuse(key, high == kHuge ? concat(n, " is below ", low)
                                  : concat(n, " is not in ", low, " .. ", high));
        return false;
    }
    void wrong_type(const std::string& key, const json& v, const char* accepted) const {
        std::string seen = v.is_structured() ? v.type_name() : v.dump();
        if (seen.size() > 60) seen = seen.substr(0, 60) + "...";
        refuse(key, concat(seen, " is not ", accepted));
    }

    Report* report_;
    const json* value_;
    std::string path_;
};

/// What the format of an accessor allows, and where it lies.
struct Accessor {
    std::string type;
    int component_type = kFloat;
    std::int64_t count = 1;
    int view = -1;
    bool normalized = false;
    bool strided = false;  ///< its buffer view has a byteStride
};

struct View {
    std::int64_t length = 0;
    std::int64_t offset = 0;
    std::int64_t stride = 0;  ///< 0: none
};

/// Columns of small matrices start on 4-byte boundaries [glTF 2.0, 3.6.2.4].
int element_bytes(const std::string& type, int component_type) {
    const int bytes = component_bytes(component_type);
    if (type.rfind("VEC", 0) == 0) return (type[3] - '0') * bytes;
    if (type.rfind("MAT", 0) == 0) return (type[3] - '0') * (((type[3] - '0') * bytes + 3) / 4 * 4);
    return bytes;
}

class Checker {
  public:
    explicit Checker(const json& document) : root_(report_, document, "") {}

    Expected<std::vector<std::string>> run() {
        asset();
        extensions();
        for (const char* key :
             {"accessors", "animations", "buffers", "bufferViews", "cameras", "images", "materials",
              "meshes", "nodes", "samplers", "scenes", "skins", "textures"}) {
            const json* v = root_.array(key);
            size_[key] = v ? v->size() : 0;
            if (v && v->empty()) root_.fault(key, "is an empty array");
            root_.each(key, [](const Object& o) { o.text("name"); });
        }
        root_.each("buffers", [&](const Object& o) { buffer(o); });
        root_.each("bufferViews", [&](const Object& o) { view(o); });
        root_.each("accessors", [&](const Object& o) { accessor(o); });
        root_.each("images", [&](const Object& o) { image(o); });
        root_.each("samplers", [&](const Object& o) { sampler(o); });
        root_.each("textures", [&](const Object& o) { texture(o); });
        root_.each("materials", [&](const Object& o) { material(o); });
        root_.each("meshes", [&](const Object& o) { mesh(o); });
        root_.each("nodes", [&](const Object& o) { node(o); });
        if (!report_.failed()) forest();
        if (!report_.failed()) root_.each("skins", [&](const Object& o) { skin(o); });
        if (!report_.failed()) root_.each("scenes", [&](const Object& o) { scene(o); });
        root_.index("scene", size_["scenes"], "scenes");
        return std::move(report_).finish();
    }

  private:
    void asset() {
        root_.require("asset");
        const auto o = root_.object("asset");
        if (!o) return;
        o->require("version");
        const auto parse = [&](const char* key, int& major, int& minor) {
            if (!o->has(key)) return;
            const std::string text = o->text(key);
            int end = 0;
            const bool digits = text.find_first_not_of("0123456789.") == std::string::npos;
            if (!digits || text.size() > 9 ||
                std::sscanf(text.c_str(), "%d.%d%n", &major, &minor, &end) != 2 ||
                static_cast<std::size_t>(end) != text.size())
                o->refuse(key, concat(shown(text), " is not a version number such as 2.0"));
        };
        int major = 2, minor = 0;
        parse("version", major, minor);
        if (major != 2)
            o->refuse("version", concat("glTF ", major, ".", minor, ": only 2.x is supported"));
        major = 2, minor = 0;
        parse("minVersion", major, minor);
        if (major != 2 || minor != 0)
            o->refuse("minVersion", concat("the file needs a reader of glTF ", major, ".", minor,
                                           ": this one reads 2.0"));
    }

    void extensions() {
        const auto names = [&](const char* key) {
            std::vector<std::string> out;
            const json* v = root_.array(key);
            if (v && v->empty()) root_.fault(key, "is an empty array");
            for (std::size_t i = 0; v && i < v->size(); ++i) {
                if ((*v)[i].is_string())
                    out.push_back((*v)[i].get<std::string>());
                else
                    root_.refuse(concat(key, "[", i, "]"), "is not a string");
            }
            return out;
        };
        for (const std::string& name : names("extensionsUsed")) used_.insert(name);
        for (const std::string& name : names("extensionsRequired")) {
            if (!is_read_extension(name))
                root_.refuse("extensionsRequired", concat("the extension ", shown(name),
                                                          " is required and not supported"));
            if (used_.insert(name).second)
                root_.fault("extensionsRequired", concat(shown(name), " is not in extensionsUsed"));
        }
        undeclared(root_.value(), "");
    }

    /// Every "extensions" is an object, and names only what extensionsUsed declares. Recursion is
    /// bounded by the depth that the container allows.
    void undeclared(const json& value, const std::string& path) {
        if (!value.is_structured()) return;
        std::size_t i = 0;
        for (const auto& [key, child] : value.items()) {
            if (!child.is_structured()) {
                ++i;
                continue;
            }
            const std::string at = value.is_array() ? concat(path, "[", i, "]")
                                   : path.empty()   ? key
                                                    : path + "." + key;
            ++i;
            if (key == "extras" && value.is_object()) continue;
            if (key == "extensions" && value.is_object()) {
                if (!child.is_object()) report_.refuse(at, "must be an object");
                for (const auto& [name, unused] : child.items())
                    if (child.is_object() && !used_.count(name) && reported_.insert(name).second)
                        report_.fault(
                            at, concat("the extension ", shown(name), " is not in extensionsUsed"));
            }
            undeclared(child, at);
        }
    }

    void buffer(const Object& o) {
        o.require("byteLength");
        buffer_bytes_.push_back(o.integer("byteLength", 1, kMaxBytes, 1));
        if (const auto uri = o.text("uri"); is_data_uri(uri)) data_uri_media(o, uri);
    }

    void data_uri_media(const Object& o, const std::string& uri) {
        const std::string media = uri.substr(5, uri.find_first_of(";,") - 5);
        if (media != "application/octet-stream" && media != "application/gltf-buffer")
            o.fault("uri",
                    concat("the media type ", shown(media), " is not application/octet-stream"));
    }

    void view(const Object& o) {
        o.require("buffer");
        o.require("byteLength");
        View v;
        const int b = o.index("buffer", size_["buffers"], "buffers");
        v.offset = o.integer("byteOffset", 0, kMaxBytes, 0);
        v.length = o.integer("byteLength", 1, kMaxBytes, 1);
        v.stride = o.integer("byteStride", 4, 252, 0);
        if (v.stride % 4 != 0) o.refuse("byteStride", concat(v.stride, " is not a multiple of 4"));
        if (v.stride > v.length)
            o.fault("byteStride", concat(v.stride, " is more than the byteLength ", v.length));
        if (b >= 0) inside(o, b, v.offset, v.length);
        if (const auto m = o.extension("EXT_meshopt_compression")) meshopt(*m, v);
        views_.push_back(v);
    }

    void inside(const Object& o, int buffer, std::int64_t offset, std::int64_t length) {
        const std::int64_t bytes = buffer_bytes_[static_cast<std::size_t>(buffer)];
        if (offset + length > bytes)
            o.refuse(concat("bytes ", offset, " .. ", offset + length, " are not inside buffers[",
                            buffer, "], which has ", bytes));
    }

    void meshopt(const Object& o, const View& view) {
        for (const char* key : {"buffer", "byteLength", "byteStride", "count", "mode"})
            o.require(key);
        const int b = o.index("buffer", size_["buffers"], "buffers");
        const auto offset = o.integer("byteOffset", 0, kMaxBytes, 0);
        const auto length = o.integer("byteLength", 1, kMaxBytes, 1);
        const auto stride = o.integer("byteStride", 1, 256, 4);
        const auto count = o.integer("count", 1, kMaxInt, 1);
        const auto mode = o.word("mode", {"ATTRIBUTES", "TRIANGLES", "INDICES"}, "ATTRIBUTES");
        const auto filter =
            o.word("filter", {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"}, "NONE");
        if (b >= 0) inside(o, b, offset, length);
        const bool attributes = mode == "ATTRIBUTES";
        const bool stride_fits = attributes ? stride % 4 == 0 : stride == 2 || stride == 4;
        if (!stride_fits) o.refuse("byteStride", concat(stride, " is not allowed in mode ", mode));
        if (mode == "TRIANGLES" && count % 3 != 0)
            o.refuse("count", concat(count, " is not a multiple of 3, as mode TRIANGLES needs"));
        if (filter != "NONE" && !attributes)
            o.refuse("filter", concat(filter, " is not allowed in mode ", mode));
        if ((filter == "OCTAHEDRAL" && stride != 4 && stride != 8) ||
            (filter == "QUATERNION" && stride != 8))
            o.refuse("filter", concat(filter, " does not go with a byteStride of ", stride));
        if (count * stride != view.length)
            o.refuse(
                concat("decodes to ", count * stride, " bytes, the buffer view has ", view.length));
    }

    /// Elements of `bytes` each, `count` of them, lie inside their view.
    void fits(const Object& o, int view, std::int64_t offset, std::int64_t count,
              std::int64_t bytes, int component, bool tight) {
        if (view < 0) return;
        const View& v = views_[static_cast<std::size_t>(view)];
        const std::int64_t stride = v.stride != 0 && !tight ? v.stride : bytes;
        if (stride < bytes)
            o.refuse(concat("elements of ", bytes, " bytes do not fit the byteStride ", stride,
                            " of bufferViews[", view, "]"));
        const std::int64_t end = offset + stride * (count - 1) + bytes;
        if (end > v.length)
            o.refuse(concat(count, " elements end at byte ", end, ", bufferViews[", view, "] has ",
                            v.length));
        if (offset % component != 0 || v.offset % component != 0)
            o.fault("byteOffset", concat("not aligned to the component's ", component, " bytes"));
    }

    void accessor(const Object& o) {
        for (const char* key : {"componentType", "type", "count"}) o.require(key);
        Accessor a;
        a.component_type =
            o.one_of("componentType", {kByte, kUByte, kShort, kUShort, kUInt, kFloat}, kFloat);
        a.type =
            o.word("type", {"SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"}, "SCALAR");
        a.count = o.integer("count", 1, kMaxInt, 1);
        a.view = o.index("bufferView", size_["bufferViews"], "bufferViews");
        a.normalized = o.boolean("normalized");
        if (a.normalized && (a.component_type == kFloat || a.component_type == kUInt))
            o.refuse("normalized", "floats and 32-bit integers cannot be normalized");
        const auto offset = o.integer("byteOffset", 0, kMaxBytes, 0);
        if (a.view < 0 && o.has("byteOffset")) o.fault("byteOffset", "needs a bufferView");
        const int bytes = element_bytes(a.type, a.component_type);
        const int component = component_bytes(a.component_type);
        fits(o, a.view, offset, a.count, bytes, component, false);
        a.strided = a.view >= 0 && views_[static_cast<std::size_t>(a.view)].stride != 0;
        for (const char* key : {"min", "max"})
            if (o.has(key)) o.numbers(key, components(a.type));

        if (const auto s = o.object("sparse")) {
            for (const char* key : {"count", "indices", "values"}) s->require(key);
            const auto count = s->integer("count", 1, a.count, 1);
            if (const auto i = s->object("indices")) {
                i->require("bufferView");
                i->require("componentType");
                const int type = i->one_of("componentType", {kUByte, kUShort, kUInt}, kUByte);
                const int size = component_bytes(type);
                fits(*i, i->index("bufferView", size_["bufferViews"], "bufferViews"),
                     i->integer("byteOffset", 0, kMaxBytes, 0), count, size, size, true);
            }
            if (const auto v = s->object("values")) {
                v->require("bufferView");
                fits(*v, v->index("bufferView", size_["bufferViews"], "bufferViews"),
                     v->integer("byteOffset", 0, kMaxBytes, 0), count, bytes, component, true);
            }
        }
        accessors_.push_back(std::move(a));
    }

    static std::size_t components(const std::string& type) {
        if (type == "SCALAR") return 1;
        const auto n = static_cast<std::size_t>(type[3] - '0');
        return type[0] == 'M' ? n * n : n;
    }

    void image(const Object& o) {
        const bool uri = o.has("uri");
        if (uri == o.has("bufferView")) o.refuse("has to have either a uri or a bufferView");
        o.text("uri");
        o.text("mimeType");
        const int v = o.index("bufferView", size_["bufferViews"], "bufferViews");
        if (v < 0) return;
        if (!o.has("mimeType")) o.fault("mimeType", "missing beside a bufferView");
        if (views_[static_cast<std::size_t>(v)].stride != 0)
            o.fault("bufferView",
                    concat("bufferViews[", v, "] holds an image and has a byteStride"));
    }

    void sampler(const Object& o) {
        o.one_of("wrapS", {33071, 33648, 10497}, 10497);
        o.one_of("wrapT", {33071, 33648, 10497}, 10497);
        o.one_of("magFilter", {9728, 9729}, 9729);
        o.one_of("minFilter", {9728, 9729, 9984, 9985, 9986, 9987}, 9729);
    }

    void texture(const Object& o) {
        o.index("source", size_["images"], "images");
        o.index("sampler", size_["samplers"], "samplers");
    }

    void texture_info(const Object& parent, const char* key) {
        const auto o = parent.object(key);
        if (!o) return;
        o->require("index");
        o->index("index", size_["textures"], "textures");
        o->integer("texCoord", 0, kMaxInt, 0);
        if (const auto t = o->extension("KHR_texture_transform")) {
            t->numbers("offset", 2);
            t->numbers("scale", 2);
            t->number("rotation", -1e9, 1e9, 0);
            t->integer("texCoord", 0, kMaxInt, 0);
        }
    }

    void material(const Object& o) {
        if (const auto pbr = o.object("pbrMetallicRoughness")) {
            pbr->numbers("baseColorFactor", 4, 0, 1);
            pbr->number("metallicFactor", 0, 1, 1);
            pbr->number("roughnessFactor", 0, 1, 1);
            texture_info(*pbr, "baseColorTexture");
            texture_info(*pbr, "metallicRoughnessTexture");
        }
        for (const char* key : {"normalTexture", "occlusionTexture", "emissiveTexture"})
            texture_info(o, key);
        for (const double e : o.numbers("emissiveFactor", 3, 0, 1e30))
            if (e > 1) o.fault("emissiveFactor", concat(e, " is more than 1"));
        o.word("alphaMode", {"OPAQUE", "MASK", "BLEND"}, "OPAQUE");
        o.number("alphaCutoff", 0, 1e30, 0.5);
        o.boolean("doubleSided");
        if (const auto e = o.extension("KHR_materials_emissive_strength"))
            e->number("emissiveStrength", 0, 1e30, 1);
        if (const auto e = o.extension("KHR_materials_ior")) {
            const double ior = e->number("ior", 0, 1e30, 1.5);
            if (ior != 0 && ior < 1) e->refuse("ior", concat(ior, " is neither 0 nor 1 or more"));
        }
        if (const auto e = o.extension("KHR_materials_specular")) {
            e->number("specularFactor", 0, 1, 1);
            e->numbers("specularColorFactor", 3, 0, 1e30);
        }
    }

    struct Format {
        const char* type;
        std::vector<int> components;  ///< integers among them must be normalized, unless `raw`
        bool raw = false;
    };

    void expect(const Object& o, const std::string& key, int index,
                const std::vector<Format>& formats) {
        const Accessor& a = accessors_[static_cast<std::size_t>(index)];
        for (const Format& f : formats) {
            const bool known = std::find(f.components.begin(), f.components.end(),
                                         a.component_type) != f.components.end();
            const bool scaled = f.raw ? true : a.component_type == kFloat || a.normalized;
            if (a.type == f.type && known && scaled) return;
        }
        o.refuse(key, concat("accessors[", index, "] is ", a.type, " of component type ",
                             a.component_type, a.normalized ? ", normalized" : "",
                             ", which is not allowed here"));
    }

    /// The formats of the attributes that are read [glTF 2.0, 3.7.2.1; KHR_mesh_quantization].
    void attribute(const Object& o, const std::string& name, int index, bool morph_target) {
        if (index < 0) return;
        const bool quantized = used_.count("KHR_mesh_quantization") != 0;
        const bool color = name.rfind("COLOR_", 0) == 0, uv = name.rfind("TEXCOORD_", 0) == 0;
        const bool joints = name.rfind("JOINTS_", 0) == 0, weights = name.rfind("WEIGHTS_", 0) == 0;
        const std::vector<int> scaled{kFloat, kUByte, kUShort};
        if (name == "POSITION") {
            std::vector<Format> formats{{"VEC3", {kFloat}}};
            if (quantized) formats.push_back({"VEC3", {kByte, kUByte, kShort, kUShort}, true});
            expect(o, name, index, formats);
        } else if (name == "NORMAL") {
            std::vector<Format> formats{{"VEC3", {kFloat}}};
            if (quantized) formats.push_back({"VEC3", {kByte, kShort}, morph_target});
            expect(o, name, index, formats);
        } else if (uv && !morph_target) {
            std::vector<Format> formats{{"VEC2", scaled}};
            if (quantized) formats.push_back({"VEC2", {kByte, kUByte, kShort, kUShort}, true});
            expect(o, name, index, formats);
        } else if (color && !morph_target) {
            expect(o, name, index, {{"VEC3", scaled}, {"VEC4", scaled}});
        } else if (joints) {
            expect(o, name, index, {{"VEC4", {kUByte, kUShort}, true}});
        } else if (weights) {
            expect(o, name, index, {{"VEC4", scaled}});
        } else if (name != "TANGENT" && !uv && !color && (name.empty() || name[0] != '_')) {
            o.fault("", concat("the attribute ", shown(name), " is not one of glTF's"));
        }
        if (accessors_[static_cast<std::size_t>(index)].component_type == kUInt)
            o.fault("", concat("the attribute ", shown(name), " has 32-bit integers"));
        use(o, index, false);
    }

    /// One buffer view holds vertices or indices, never both [glTF 2.0, 3.6.1].
    void use(const Object& o, int accessor, bool as_indices) {
        const int v = accessors_[static_cast<std::size_t>(accessor)].view;
        if (v < 0) return;
        if (const auto [it, is_new] = view_holds_indices_.emplace(v, as_indices);
            !is_new && it->second != as_indices)
            o.fault("", concat("bufferViews[", v, "] holds both vertices and indices"));
    }

    void mesh(const Object& o) {
        const json* weights = o.array("weights");
        if (weights) o.numbers("weights", weights->size());
        o.require("primitives");
        if (const json* p = o.array("primitives"); p && p->empty())
            o.refuse("primitives", "is an empty array");
        bool skinned = true;
        std::size_t target_count = 0;
        bool first = true;
        o.each("primitives", [&](const Object& p) {
            skinned = primitive(p) && skinned;
            const json* targets = p.array("targets");
            const std::size_t n = targets ? targets->size() : 0;
            if (!first && n != target_count)
                p.refuse("targets",
                         concat("has ", n, " elements, the first primitive of the mesh has ",
                                target_count));
            target_count = n;
            first = false;
        });
        if (weights && weights->size() != target_count)
            o.refuse("weights", concat("has ", weights->size(), " elements for ", target_count,
                                       " morph targets"));
        skinned_.push_back(skinned);
        target_count_.push_back(target_count);
    }

    /// Returns whether the primitive can be skinned.
    bool primitive(const Object& o) {
        o.require("attributes");
        o.one_of("mode", {0, 1, 2, 3, 4, 5, 6}, 4);
        o.index("material", size_["materials"], "materials");
        const int indices = o.index("indices", size_["accessors"], "accessors");
        if (indices >= 0) {
            const Accessor& a = accessors_[static_cast<std::size_t>(indices)];
            expect(o, "indices", indices, {{"SCALAR", {kUByte, kUShort, kUInt}, true}});
            if (a.normalized) o.refuse("indices", concat("accessors[", indices, "] is normalized"));
            if (a.strided) o.fault("indices", "the buffer view has a byteStride");
            use(o, indices, true);
        }
        const auto attributes = o.object("attributes");
        if (!attributes) return false;
        if (attributes->value().empty()) o.refuse("attributes", "is empty");
        std::int64_t count = -1;
        for (const auto& [name, v] : attributes->value().items()) {
            const int index = attributes->index_of(v, name, size_["accessors"], "accessors");
            attribute(*attributes, name, index, false);
            if (index < 0) continue;
            const std::int64_t n = accessors_[static_cast<std::size_t>(index)].count;
            if (count >= 0 && n != count)
                attributes->refuse(name,
                                   concat("has ", n, " elements, another attribute has ", count));
            count = n;
        }
        joints_and_weights(*attributes);
        o.each("targets", [&](const Object& target) {
            for (const auto& [name, v] : target.value().items()) {
                const int index = target.index_of(v, name, size_["accessors"], "accessors");
                attribute(target, name, index, true);
                if (index >= 0 && accessors_[static_cast<std::size_t>(index)].count != count)
                    target.refuse(name,
                                  concat("has ", accessors_[static_cast<std::size_t>(index)].count,
                                         " elements, the base attributes have ", count));
            }
        });
        if (const auto d = o.extension("KHR_draco_mesh_compression")) {
            d->require("bufferView");
            d->require("attributes");
            d->index("bufferView", size_["bufferViews"], "bufferViews");
            if (const auto a = d->object("attributes"))
                for (const auto& [name, unused] : a->value().items()) {
                    a->integer(name.c_str(), 0, kMaxInt, 0);
                    if (!attributes->has(name.c_str()))
                        a->refuse(name, "is not an attribute of the primitive");
                }
        }
        return attributes->has("JOINTS_0") && attributes->has("WEIGHTS_0");
    }

    static void joints_and_weights(const Object& attributes) {
        for (const auto& [name, unused] : attributes.value().items()) {
            std::string other;
            if (name.rfind("JOINTS_", 0) == 0) other = "WEIGHTS_" + name.substr(7);
            if (name.rfind("WEIGHTS_", 0) == 0) other = "JOINTS_" + name.substr(8);
            if (!other.empty() && !attributes.has(other.c_str()))
                attributes.refuse(name, concat("there is no ", shown(other), " beside it"));
        }
    }

    void node(const Object& o) {
        o.index("camera", size_["cameras"], "cameras");
        const int mesh = o.index("mesh", size_["meshes"], "meshes");
        const int skin = o.index("skin", size_["skins"], "skins");
        if (skin >= 0 && mesh >= 0 && !skinned_[static_cast<std::size_t>(mesh)])
            o.refuse("skin",
                     concat("meshes[", mesh, "] has a primitive without JOINTS_0 and WEIGHTS_0"));
        if (o.has("skin") && !o.has("mesh")) o.fault("skin", "needs a mesh");
        if (const json* w = o.array("weights")) {
            const std::size_t targets =
                mesh >= 0 ? target_count_[static_cast<std::size_t>(mesh)] : 0;
            if (!o.has("mesh"))
                o.fault("weights", "needs a mesh");
            else
                o.numbers("weights", targets);
            if (w->empty()) o.fault("weights", "is an empty array");
        }
        children_.push_back(o.indices("children", size_["nodes"], "nodes"));

        const bool trs = o.has("translation") || o.has("rotation") || o.has("scale");
        if (const auto m = o.numbers("matrix", 16); !m.empty()) {
            if (trs) o.refuse("matrix", "stands beside translation, rotation or scale");
            if (m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1)
                o.refuse("matrix", "is not affine: its last row is not 0 0 0 1");
        }
        o.numbers("translation", 3);
        o.numbers("scale", 3);
        if (const auto q = o.numbers("rotation", 4); !q.empty()) {
            // 1 % covers exporters that round; a sloppy quaternion is normalised when it is read.
            const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
            if (!(std::abs(length - 1) < 0.01))
                o.refuse("rotation", concat("a quaternion of length ", length, ", it must be 1"));
        }
    }

    /// Every node has one parent at most, and none is its own ancestor.
    void forest() {
        parent_.assign(children_.size(), -1);
        for (std::size_t i = 0; i < children_.size(); ++i) {
            for (const int child : children_[i]) {
                int& parent = parent_[static_cast<std::size_t>(child)];
                if (parent >= 0) {
                    report_.refuse(
                        concat("nodes[", child, "]"),
                        concat("is a child of both nodes[", parent, "] and nodes[", i, "]"));
                    return;
                }
                parent = static_cast<int>(i);
            }
        }
        // With one parent each, walking up ends at a root or circles; walks are numbered from 1.
        std::vector<std::size_t> walked(parent_.size(), 0);
        for (std::size_t i = 0; i < parent_.size(); ++i) {
            int at = static_cast<int>(i);
            while (at >= 0 && walked[static_cast<std::size_t>(at)] == 0) {
                walked[static_cast<std::size_t>(at)] = i + 1;
                at = parent_[static_cast<std::size_t>(at)];
            }
            if (at >= 0 && walked[static_cast<std::size_t>(at)] == i + 1) {
                report_.refuse(concat("nodes[", at, "]"), "is its own ancestor");
                return;
            }
        }
        root_of_.assign(parent_.size(), -1);
        std::vector<int> chain;
        for (std::size_t i = 0; i < parent_.size(); ++i) {
            int at = static_cast<int>(i);
            chain.clear();
            while (root_of_[static_cast<std::size_t>(at)] < 0 &&
                   parent_[static_cast<std::size_t>(at)] >= 0) {
                chain.push_back(at);
                at = parent_[static_cast<std::size_t>(at)];
            }
            int& known = root_of_[static_cast<std::size_t>(at)];
            if (known < 0) known = at;
            const int root = known;
            for (const int n : chain) root_of_[static_cast<std::size_t>(n)] = root;
        }
    }

    void skin(const Object& o) {
        o.require("joints");
        const auto joints = o.indices("joints", size_["nodes"], "nodes");
        if (joints.empty()) o.refuse("joints", "is empty");
        if (report_.failed()) return;
        for (const int j : joints)
            if (root_of_[static_cast<std::size_t>(j)] !=
                root_of_[static_cast<std::size_t>(joints[0])]) {
                o.fault("joints",
                        concat("nodes[", joints[0], "] and nodes[", j, "] have no common root"));
                break;
            }
        if (const int s = o.index("skeleton", size_["nodes"], "nodes"); s >= 0)
            if (root_of_[static_cast<std::size_t>(s)] !=
                root_of_[static_cast<std::size_t>(joints[0])])
                o.fault("skeleton", concat("nodes[", s, "] is no common root of the joints"));
        const int m = o.index("inverseBindMatrices", size_["accessors"], "accessors");
        if (m < 0) return;
        expect(o, "inverseBindMatrices", m, {{"MAT4", {kFloat}}});
        const Accessor& a = accessors_[static_cast<std::size_t>(m)];
        if (a.count < static_cast<std::int64_t>(joints.size()))
            o.refuse("inverseBindMatrices",
                     concat("has ", a.count, " matrices for ", joints.size(), " joints"));
        if (a.strided) o.fault("inverseBindMatrices", "the buffer view has a byteStride");
    }

    void scene(const Object& o) {
        for (const int n : o.indices("nodes", size_["nodes"], "nodes"))
            if (n >= 0 && parent_[static_cast<std::size_t>(n)] >= 0)
                o.refuse("nodes", concat("nodes[", n, "] is not a root: it is a child of nodes[",
                                         parent_[static_cast<std::size_t>(n)], "]"));
    }

    Report report_;
    Object root_;
    std::map<std::string, std::size_t> size_;  ///< of the top-level collections
    std::set<std::string> used_, reported_;    ///< extensions
    std::vector<std::int64_t> buffer_bytes_;
    std::vector<View> views_;
    std::vector<Accessor> accessors_;
    std::map<int, bool> view_holds_indices_;
    std::vector<bool> skinned_;              ///< meshes whose primitives all have joints
    std::vector<std::size_t> target_count_;  ///< morph targets of the meshes
    std::vector<std::vector<int>> children_;
    std::vector<int> parent_, root_of_;
};

}  // namespace

bool is_read_extension(std::string_view name) {
    return std::find(kReadExtensions.begin(), kReadExtensions.end(), name) != kReadExtensions.end();
}

int component_bytes(int component_type) {
    switch (component_type) {
        case kByte:
        case kUByte:
            return 1;
        case kShort:
        case kUShort:
            return 2;
        case kUInt:
        case kFloat:
            return 4;
        default:
            return 0;
    }
}

Expected<std::vector<std::string>> check_document(const json& document) {
    return Checker(document).run();
}

}  // namespace envbake::gltf
