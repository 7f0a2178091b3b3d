# Everything comes from the distribution (docs/dependencies.md says what each is for).
find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(OpenImageIO 2.4 REQUIRED)
find_package(fmt 9 REQUIRED)
find_package(nlohmann_json 3.11 REQUIRED)
find_package(HWY 1.0.3 REQUIRED)
find_package(ZLIB 1.2 REQUIRED)
find_package(SQLite3 3.34 REQUIRED)
