#include "fuzz.salt"
#include <a
#include x
void main() {}
