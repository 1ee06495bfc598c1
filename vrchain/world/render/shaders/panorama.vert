#version 330 core
// Positions in the world; colour_0 holds the baked light, RGB, and the object's id, a whole number.
layout(location = 0) in vec3 position;
layout(location = 1) in vec2 texcoord;
layout(location = 2) in vec4 light_and_id;

uniform mat4 camera;
#ifdef GROUND
uniform vec4 map_area;  // of the light map: its lowest corner and its size

out vec2 map_uv;
#endif
out vec2 uv;
out vec3 light;
flat out vec3 id;

void main()
{
    gl_Position = camera * vec4(position, 1.0);
    uv = texcoord;
    light = light_and_id.rgb;
    id = mod(floor(light_and_id.w / vec3(1.0, 256.0, 65536.0)), 256.0) / 255.0;
#ifdef GROUND
    map_uv = (position.xy - map_area.xy) / map_area.zw;
#endif
}
