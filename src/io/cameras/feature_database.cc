#include "io/cameras/feature_database.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <algorithm>
#include <cstring>

#include "nerf/base/error.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

constexpr int64_t kMostImages = 2147483647;  // pair_id = kMostImages * lower id + higher id
constexpr int kBusyMilliseconds = 10000;

int64_t pair_id(const ImageIdPair& pair) { return kMostImages * pair.first + pair.second; }
ImageIdPair pair_of(int64_t id) { return {id / kMostImages, id % kMostImages}; }

}  // namespace

struct FeatureDatabase::Impl {
  fs::path file;
  sqlite3* db = nullptr;

  [[noreturn]] void fail(const std::string& what) const {
    throw Error(what + ": " + sqlite3_errmsg(db), file.string(),
                "remove the folder that it lies in and run again");
  }
  void run(const char* sql) {
    if (sqlite3_exec(db, sql, nullptr, nullptr, nullptr) != SQLITE_OK)
      fail("cannot write colmap's database");
  }
  std::vector<ImageIdPair> pairs(const char* sql) const;
  // `sql` has one parameter, the pair.
  std::vector<FeatureMatch> matches(const char* sql, const ImageIdPair& pair) const;
};

namespace {

// A statement with its parameters, and the rows that it gives.
class Query {
 public:
  Query(sqlite3* db, const fs::path& file, const char* sql) : db_(db), file_(file) {
    check(sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr) == SQLITE_OK);
  }
  ~Query() { sqlite3_finalize(statement_); }
  Query(const Query&) = delete;
  Query& operator=(const Query&) = delete;

  Query& bind(int index, int64_t value) {
    check(sqlite3_bind_int64(statement_, index, value) == SQLITE_OK);
    return *this;
  }
  Query& bind(int index, const void* bytes, size_t size) {
    check(sqlite3_bind_blob64(statement_, index, bytes, size, SQLITE_STATIC) == SQLITE_OK);
    return *this;
  }
  bool next() {
    const int code = sqlite3_step(statement_);
    check(code == SQLITE_ROW || code == SQLITE_DONE);
    return code == SQLITE_ROW;
  }
  int64_t integer(int column) { return sqlite3_column_int64(statement_, column); }
  std::string text(int column) {
    const void* data = sqlite3_column_blob(statement_, column);
    const auto size = static_cast<size_t>(sqlite3_column_bytes(statement_, column));
    return data ? std::string(static_cast<const char*>(data), size) : "";
  }
  // rows x columns values of `size` bytes, as the table says; the blob has to hold them.
  std::vector<uint8_t> matrix(int64_t columns, int64_t size) {
    const int64_t rows = integer(0);
    const void* data = sqlite3_column_blob(statement_, 2);
    const int64_t bytes = sqlite3_column_bytes(statement_, 2);
    if (rows < 0 || rows > bytes / (columns * size) || bytes != rows * columns * size ||
        (rows > 0 && integer(1) != columns)) {
      throw Error(fmt::format("colmap's database holds {} x {} values in {} bytes", rows,
                              integer(1), bytes),
                  file_.string(), "remove the folder that it lies in and run again");
    }
    std::vector<uint8_t> out(static_cast<size_t>(bytes));
    if (bytes > 0) std::memcpy(out.data(), data, out.size());
    return out;
  }

 private:
  void check(bool good) const {
    if (good) return;
    throw Error(std::string("cannot read colmap's database: ") + sqlite3_errmsg(db_),
                file_.string(), "remove the folder that it lies in and run again");
  }

  sqlite3* db_;
  fs::path file_;
  sqlite3_stmt* statement_ = nullptr;
};

}  // namespace

std::vector<ImageIdPair> FeatureDatabase::Impl::pairs(const char* sql) const {
  Query query(db, file, sql);
  std::vector<ImageIdPair> out;
  while (query.next()) out.push_back(pair_of(query.integer(0)));
  return out;
}

std::vector<FeatureMatch> FeatureDatabase::Impl::matches(const char* sql,
                                                         const ImageIdPair& pair) const {
  Query query(db, file, sql);
  query.bind(1, pair_id(pair));
  if (!query.next()) return {};
  const std::vector<uint8_t> bytes = query.matrix(2, sizeof(uint32_t));
  std::vector<FeatureMatch> out(bytes.size() / sizeof(FeatureMatch));
  if (!out.empty()) std::memcpy(out.data(), bytes.data(), bytes.size());
  return out;
}

FeatureDatabase::FeatureDatabase(const fs::path& file) : impl_(std::make_unique<Impl>()) {
  impl_->file = file;
  if (sqlite3_open_v2(file.c_str(), &impl_->db, SQLITE_OPEN_READWRITE, nullptr) != SQLITE_OK) {
    const std::string reason = sqlite3_errmsg(impl_->db);
    sqlite3_close(impl_->db);
    throw Error("cannot open colmap's database: " + reason, file.string());
  }
  sqlite3_busy_timeout(impl_->db, kBusyMilliseconds);
  sqlite3_exec(impl_->db, "PRAGMA synchronous = NORMAL", nullptr, nullptr, nullptr);
}

FeatureDatabase::~FeatureDatabase() { sqlite3_close(impl_->db); }

std::vector<FeatureDatabase::Image> FeatureDatabase::images() {
  Query query(impl_->db, impl_->file, "SELECT image_id, camera_id, name FROM images ORDER BY name");
  std::vector<Image> out;
  while (query.next()) {
    const int64_t id = query.integer(0);
    if (id < 1 || id >= kMostImages)
      throw Error(fmt::format("colmap's database has an image with the id {}", id),
                  impl_->file.string());
    out.push_back({id, query.integer(1), query.text(2)});
  }
  return out;
}

int64_t FeatureDatabase::feature_count(int64_t image) {
  Query query(impl_->db, impl_->file, "SELECT rows FROM descriptors WHERE image_id = ?");
  query.bind(1, image);
  return query.next() ? query.integer(0) : 0;
}

std::vector<uint8_t> FeatureDatabase::descriptors(int64_t image) {
  Query query(impl_->db, impl_->file,
              "SELECT rows, cols, data FROM descriptors WHERE image_id = ?");
  query.bind(1, image);
  return query.next() ? query.matrix(kDescriptorBytes, 1) : std::vector<uint8_t>();
}

std::vector<FeaturePlace> FeatureDatabase::places(int64_t image) {
  Query query(impl_->db, impl_->file, "SELECT rows, cols, data FROM keypoints WHERE image_id = ?");
  query.bind(1, image);
  if (!query.next()) return {};
  // x and y, and what says how large the feature is and how it is turned.
  const int64_t columns = std::max<int64_t>(query.integer(1), 2);
  const std::vector<uint8_t> bytes = query.matrix(columns, sizeof(float));
  const size_t stride = static_cast<size_t>(columns) * sizeof(float);
  std::vector<FeaturePlace> out(bytes.size() / stride);
  for (size_t i = 0; i < out.size(); ++i)
    std::memcpy(&out[i], bytes.data() + i * stride, sizeof(FeaturePlace));
  return out;
}

std::vector<ImageIdPair> FeatureDatabase::matched_pairs() {
  return impl_->pairs("SELECT pair_id FROM matches ORDER BY pair_id");
}

void FeatureDatabase::write_matches(const ImageIdPair& pair,
                                    const std::vector<FeatureMatch>& matches) {
  static_assert(sizeof(FeatureMatch) == 2 * sizeof(uint32_t));
  NERF_CHECK(pair.first < pair.second);
  Query query(impl_->db, impl_->file,
              "INSERT OR REPLACE INTO matches(pair_id, rows, cols, data) VALUES(?, ?, 2, ?)");
  query.bind(1, pair_id(pair)).bind(2, static_cast<int64_t>(matches.size()));
  query.bind(3, matches.empty() ? static_cast<const void*>("") : matches.data(),
             matches.size() * sizeof(FeatureMatch));
  query.next();
}

std::vector<FeatureMatch> FeatureDatabase::matches(const ImageIdPair& pair) {
  return impl_->matches("SELECT rows, cols, data FROM matches WHERE pair_id = ?", pair);
}

std::vector<ImageIdPair> FeatureDatabase::verified_pairs() {
  return impl_->pairs("SELECT pair_id FROM two_view_geometries WHERE rows > 0 ORDER BY pair_id");
}

std::vector<FeatureMatch> FeatureDatabase::verified_matches(const ImageIdPair& pair) {
  return impl_->matches("SELECT rows, cols, data FROM two_view_geometries WHERE pair_id = ?", pair);
}

void FeatureDatabase::replace_verified_matches(const ImageIdPair& pair,
                                               const std::vector<FeatureMatch>& matches) {
  Query query(impl_->db, impl_->file,
              "UPDATE two_view_geometries SET rows = ?, data = ? WHERE pair_id = ?");
  query.bind(1, static_cast<int64_t>(matches.size())).bind(3, pair_id(pair));
  query.bind(2, matches.empty() ? static_cast<const void*>("") : matches.data(),
             matches.size() * sizeof(FeatureMatch));
  query.next();
}

void FeatureDatabase::fill_with_no_matches() {
  impl_->run(
      "INSERT OR IGNORE INTO matches(pair_id, rows, cols, data) "
      "SELECT a.image_id * 2147483647 + b.image_id, 0, 2, zeroblob(0) "
      "FROM images a JOIN images b ON a.image_id < b.image_id");
}

void FeatureDatabase::begin() { impl_->run("BEGIN"); }
void FeatureDatabase::commit() { impl_->run("COMMIT"); }

}  // namespace nerf::internal
