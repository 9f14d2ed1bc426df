#pragma once

// This project includes tinygltf only by this header: without its file access and its image
// decoder, so that nothing that it meets in a document can make it open or decode anything. Only
// .cpp files include it.
#define TINYGLTF_NO_FS
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#include <tiny_gltf.h>
