#version 330 core
// The picture in its baked light; or, for OBJECTS, the id of what is there.
uniform sampler2D picture;
#ifdef GROUND
uniform sampler2D light_map;

in vec2 map_uv;
#endif
in vec2 uv;
in vec3 light;
flat in vec3 id;
out vec4 colour;

void main()
{
#ifdef CUT_OUT
    // All or nothing, by the nearest texel of the finest level: just what the ray caster looks up.
    ivec2 size = textureSize(picture, 0);
    ivec2 texel = min(ivec2(fract(uv) * size), size - 1);
    if (texelFetch(picture, texel, 0).a < 127.5 / 255.0) discard;
#endif
#ifdef OBJECTS
    colour = vec4(id, 1.0);
#else
    vec3 lit = texture(picture, uv).rgb * light;
#ifdef GROUND
    lit *= texture(light_map, map_uv).rgb;
#endif
    colour = vec4(lit, 1.0);
#endif
}
